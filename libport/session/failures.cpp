#include "libport/session/failures.hpp"

#include <algorithm>
#include <utility>

namespace porttape {

bool Failures::failed(Instant now, const std::string& what) {
  const std::optional<Instant> since = std::exchange(up_since_, std::nullopt);
  if (since && now - *since >= kLineHeld) worked();
  // A driver that tries it once more, or now and then, does not wait.
  if (now - may_open_ >= kLongestWait) wait_.reset();
  may_open_ = in_a_row() ? now + wait_.next() : now;
  if (std::ranges::find(told_, what) == told_.end() && told_.size() < kMostTold) {
    told_.push_back(what);
    return true;
  }
  ++untold_;
  return false;
}

void Failures::worked() {
  told_.clear();
  over_ += std::exchange(untold_, 0);
  may_open_ = {};
  wait_.reset();
}

std::optional<std::uint64_t> Failures::take_untold() {
  const std::uint64_t count = std::exchange(over_, 0);
  return count > 0 ? std::optional(count) : std::nullopt;
}

}  // namespace porttape
