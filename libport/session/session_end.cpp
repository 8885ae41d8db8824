#include "libport/session/session_end.hpp"

#include <algorithm>

namespace porttape {

SessionEnd::Stop SessionEnd::stop() {
  stops_ = std::min(stops_ + 1, 2);
  if (running()) return Stop::begin;
  return stops_ == 1 ? Stop::wait : Stop::give_up;
}

bool SessionEnd::go_on(Step next) {
  if (step_ >= next) return false;
  step_ = next;
  return true;
}

bool SessionEnd::send(Instant now) {
  if (!go_on(Step::sending)) return false;
  wait_.emplace(now, pace_ == Pace::failed ? limits_.failed_step : limits_.without_progress);
  return true;
}

bool SessionEnd::waits_on(Instant now, std::optional<std::size_t> left) {
  return wait_ && wait_->goes_on(now, pace_ == Pace::failed ? std::nullopt : left);
}

Nanos SessionEnd::completing_limit() const {
  if (stops_ > 1) return limits_.at_once;
  return pace_ == Pace::failed ? limits_.failed_step : limits_.completing;
}

}  // namespace porttape
