#pragma once

#include <chrono>
#include <deque>
#include <functional>
#include <vector>

#include "libport/base/time.hpp"

namespace porttape {

// A time in which a loop did not do its work: a handler took long, or the process was stopped or got no
// processor.
struct Stall {
  Instant begin;
  Nanos length;

  friend bool operator==(const Stall&, const Stall&) = default;
};

// Keeps the latest stalls of one loop. Pure: the loop tells it the times.
class StallWatch {
 public:
  static constexpr Nanos kShortest = std::chrono::milliseconds(50);
  static constexpr std::size_t kKept = 64;

  // Nothing was done from `begin` to `end` but one thing, or nothing at all. Short ones are ignored; one that
  // overlaps the last makes that longer.
  void late(Instant begin, Instant end) {
    if (end - begin > kShortest) note(begin, end);
  }
  // Those that ended after `moment`, oldest first.
  [[nodiscard]] std::vector<Stall> since(Instant moment) const;
  // Called once a stall, by the one who saw it.
  void on_stall(std::function<void(const Stall&)> hook) { hook_ = std::move(hook); }

 private:
  void note(Instant begin, Instant end);

  std::deque<Stall> stalls_;
  std::function<void(const Stall&)> hook_;
};

}  // namespace porttape
