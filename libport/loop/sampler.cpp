#include "libport/loop/sampler.hpp"

#include <algorithm>
#include <utility>
#include <vector>

namespace porttape {

Sampler::Sampler(Loop& loop) : loop_(&loop), timer_(loop, [this] { on_timer(); }) {}

void Sampler::add(const void* owner, std::function<void()> look) {
  const Instant now = loop_->now();
  std::shared_ptr<Member>& member = members_[owner];
  if (member) member->removed = true;  // its look may be what calls this
  member = std::make_shared<Member>(Member{std::move(look), loop_->fence(), now + kYoung, now});
  look_within(kQuick);
}

void Sampler::touch(const void* owner) {
  const auto member = members_.find(owner);
  if (member == members_.end()) return;
  member->second->active_until = loop_->now() + kActive;
  look_within(kSlow);
}

void Sampler::look_within(Nanos time) {
  const Instant at = loop_->now() + time;
  if (!timer_.due() || *timer_.due() > at) timer_.set(at);
}

void Sampler::remove(const void* owner) {
  const auto member = members_.find(owner);
  if (member == members_.end()) return;
  member->second->removed = true;
  members_.erase(member);
  if (members_.empty()) timer_.cancel();
}

void Sampler::on_timer() {
  const Instant now = loop_->now();
  const bool everyone = now >= next_rare_;
  const bool the_active = everyone || now >= next_slow_;
  if (everyone) next_rare_ = now + kRarely;
  if (the_active) next_slow_ = now + kSlow;
  Instant next = next_rare_;
  std::vector<std::shared_ptr<Member>> round;
  for (const auto& [owner, member] : members_) {
    const bool young = now < member->young_until;
    const bool active = now < member->active_until;
    if (young) next = std::min(next, now + kQuick);
    if (active) next = std::min(next, next_slow_);
    if (everyone || young || (active && the_active)) round.push_back(member);
  }
  timer_.set(next);
  for (const auto& member : round) {
    if (!member->removed) loop_->within(member->fence, member->look);
  }
}

}  // namespace porttape
