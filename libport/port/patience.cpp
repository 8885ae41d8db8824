#include "libport/port/patience.hpp"

#include <algorithm>

namespace porttape {

void Patience::waited(Nanos time) {
  short_waits_ = time <= kShortWait ? std::min(short_waits_ + 1, kShortWaitsInARow) : 0;
}

void Patience::polled(Instant last, Instant now) {
  if (now - last < kPreempted) return;
  rests_until_ = now + rest_;
  rest_ = std::min(rest_ * 2, kLongestRest);
  short_waits_ = 0;
}

bool Patience::expects_soon(Instant now) const {
  return short_waits_ == kShortWaitsInARow && now >= rests_until_;
}

}  // namespace porttape
