#include "libport/loop/sampler.hpp"

#include <algorithm>
#include <utility>

namespace porttape {

Sampler::Sampler(Loop& loop) : loop_(&loop), timer_(loop, [this] { on_timer(); }) {}

void Sampler::add(const void* owner, std::function<void()> look) {
  const Instant now = Loop::now();
  members_[owner] = {std::move(look), loop_->fence(), now + kYoung};
  if (!timer_.due() || *timer_.due() > now + kQuick) timer_.set(now + kQuick);
}

void Sampler::remove(const void* owner) {
  members_.erase(owner);
  if (members_.empty()) timer_.cancel();
}

void Sampler::on_timer() {
  const Instant now = Loop::now();
  const bool everyone = now >= next_slow_;
  if (everyone) next_slow_ = now + kSlow;
  bool young = false;
  for (const auto& [owner, member] : members_) {
    const bool is_young = now < member.young_until;
    young = young || is_young;
    if (everyone || is_young) loop_->within(member.fence, member.look);
  }
  timer_.set(young ? std::min(next_slow_, now + kQuick) : next_slow_);
}

}  // namespace porttape
