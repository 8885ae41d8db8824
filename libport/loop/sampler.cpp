#include "libport/loop/sampler.hpp"

#include <algorithm>
#include <utility>
#include <vector>

namespace porttape {

Sampler::Sampler(Loop& loop) : loop_(&loop), timer_(loop, [this] { on_timer(); }) {}

void Sampler::add(const void* owner, std::function<void()> look) {
  const Instant now = Loop::now();
  std::shared_ptr<Member>& member = members_[owner];
  if (member) member->removed = true;  // its look may be what calls this
  member = std::make_shared<Member>(Member{std::move(look), loop_->fence(), now + kYoung});
  if (!timer_.due() || *timer_.due() > now + kQuick) timer_.set(now + kQuick);
}

void Sampler::remove(const void* owner) {
  const auto member = members_.find(owner);
  if (member == members_.end()) return;
  member->second->removed = true;
  members_.erase(member);
  if (members_.empty()) timer_.cancel();
}

void Sampler::on_timer() {
  const Instant now = Loop::now();
  const bool everyone = now >= next_slow_;
  if (everyone) next_slow_ = now + kSlow;
  bool young = false;
  std::vector<std::shared_ptr<Member>> round;
  for (const auto& [owner, member] : members_) {
    const bool is_young = now < member->young_until;
    young = young || is_young;
    if (everyone || is_young) round.push_back(member);
  }
  timer_.set(young ? std::min(next_slow_, now + kQuick) : next_slow_);
  for (const auto& member : round) {
    if (!member->removed) loop_->within(member->fence, member->look);
  }
}

}  // namespace porttape
