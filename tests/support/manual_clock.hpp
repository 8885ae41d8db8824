#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <optional>

#include "libport/base/clock.hpp"
#include "libport/loop/loop.hpp"

namespace porttape {

// A clock that stands until a test moves it.
class ManualClock final : public Clock {
 public:
  [[nodiscard]] Instant now() const override { return Instant(now_.load()); }
  [[nodiscard]] WallTime wall() const override {
    return WallTime(std::chrono::seconds(1'700'000'000)) + now_.load();
  }
  // What has come already is in the past for the machine's clock as well.
  [[nodiscard]] std::optional<Instant> machine_time(Instant when) const override {
    return when <= now() ? std::optional(Instant{}) : std::nullopt;
  }

  // The loops that have the clock are to be told: Loop::clock_moved().
  void set(Instant moment) { now_ = moment.time_since_epoch(); }
  void pass(Nanos time) { set(now() + time); }

 private:
  std::atomic<Nanos> now_{std::chrono::hours(1)};
};

// Handles everything that does not need time to pass, results of worker threads included.
inline void settle(Loop& loop) {
  loop.restart();  // it may have run out of work before
  for (;;) {
    const bool has_jobs = loop.has_jobs();  // before the look: a result that comes after it is waited for
    if (loop.poll_one()) continue;
    if (!has_jobs) return;
    loop.run_one();
  }
}

// Lets `time` pass on the loop, from one timer to the next, or less where `done` holds sooner. Returns
// whether it does.
inline bool let_pass(
    Loop& loop, ManualClock& clock, Nanos time, const std::function<bool()>& done = [] { return false; }) {
  const Instant end = clock.now() + time;
  settle(loop);
  while (!done() && clock.now() < end) {
    clock.set(std::min(std::max(loop.next_timer().value_or(end), clock.now()), end));
    loop.clock_moved();
    settle(loop);
  }
  return done();
}

}  // namespace porttape
