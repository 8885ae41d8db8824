#include "libport/replay/timeline.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

namespace porttape {
namespace {

// Far enough for any tape (146 years), with room to be added to.
constexpr std::int64_t kFarNanos = std::int64_t{1} << 62;

// Keeps the rounding error of a rate such as 0.3 from costing a whole nanosecond.
constexpr long double kRoundingSlack = 1e-6L;

std::int64_t clamp_to_int64(long double value, std::int64_t limit) {
  const auto bound = static_cast<long double>(limit);
  return static_cast<std::int64_t>(std::clamp(value, -bound, bound));
}

}  // namespace

Instant saturating_add(Instant start, Nanos gap) {
  std::int64_t sum = 0;
  if (__builtin_add_overflow(start.time_since_epoch().count(), gap.count(), &sum)) {
    sum =
        gap.count() > 0 ? std::numeric_limits<std::int64_t>::max() : std::numeric_limits<std::int64_t>::min();
  }
  return Instant{Nanos{sum}};
}

Instant Timeline::after(Instant start, Micros tape_gap) const {
  // At the rate of the tape nothing is to be rounded, which is the slow part.
  const bool far = tape_gap.count() > kFarNanos / 1000 || tape_gap.count() < -kFarNanos / 1000;
  if (rate_ == 1.0 && !far) return saturating_add(start, tape_gap);
  const long double nanos =
      static_cast<long double>(tape_gap.count()) * 1000.0L / static_cast<long double>(rate_);
  return saturating_add(start, Nanos{clamp_to_int64(std::ceil(nanos - kRoundingSlack), kFarNanos)});
}

TapeTime Timeline::tape(Instant real) const { return tape_ + since(real_, real); }

Micros Timeline::since(Instant from, Instant to) const {
  const long double nanos = static_cast<long double>(to.time_since_epoch().count()) -
                            static_cast<long double>(from.time_since_epoch().count());
  const long double micros = nanos * static_cast<long double>(rate_) / 1000.0L;
  return Micros{clamp_to_int64(std::floor(micros), kFarNanos / 1000)};
}

}  // namespace porttape
