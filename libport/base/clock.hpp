#pragma once

#include <chrono>
#include <optional>

#include "libport/base/time.hpp"

namespace porttape {

// The time of day, in UTC.
using WallTime = std::chrono::sys_time<std::chrono::nanoseconds>;

// A source of time: the machine's, or one that its owner moves, as a test and the virtual time of a
// supervised program do. A Loop is given one, and everything on that loop asks the loop. Outlives all that it
// was given to. A clock may be read from any thread.
class Clock {
 public:
  Clock() = default;
  virtual ~Clock() = default;
  Clock(const Clock&) = delete;
  Clock& operator=(const Clock&) = delete;

  // The current moment. It never goes back.
  [[nodiscard]] virtual Instant now() const = 0;
  // The time of day at the current moment, for dates that people read.
  [[nodiscard]] virtual WallTime wall() const = 0;
  // The moment of the machine's clock at which this clock will read `when`: how long a wait has to last.
  // nullopt if this clock does not pass by itself; who moves it calls Loop::clock_moved().
  [[nodiscard]] virtual std::optional<Instant> machine_time(Instant when) const = 0;
};

// The clock of this machine (CLOCK_MONOTONIC and CLOCK_REALTIME). Programs hand it to their loops. Nothing
// else names it but the code whose subject is the machine itself, such as how long a disk takes;
// tests/layout has the list of these places.
const Clock& machine_clock();

}  // namespace porttape
