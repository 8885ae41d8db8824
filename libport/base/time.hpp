#pragma once

#include <chrono>
#include <cstdint>

namespace porttape {

// A moment of this machine's monotonic clock. The pure layers take it as an argument; only ports and programs
// read it.
using Instant = std::chrono::time_point<std::chrono::steady_clock, std::chrono::nanoseconds>;
using Nanos = std::chrono::nanoseconds;
using Micros = std::chrono::microseconds;

// The clock of a tape: microseconds since its zero, the moment the driver first opened the port. It has no
// now().
struct TapeClock {
  using rep = std::int64_t;
  using period = std::micro;
  using duration = std::chrono::duration<rep, period>;
  using time_point = std::chrono::time_point<TapeClock>;
  static constexpr bool is_steady = true;
};
using TapeTime = TapeClock::time_point;

constexpr TapeTime tape_time_us(std::int64_t us) { return TapeTime{Micros{us}}; }
constexpr std::int64_t to_us(TapeTime t) { return t.time_since_epoch().count(); }

}  // namespace porttape
