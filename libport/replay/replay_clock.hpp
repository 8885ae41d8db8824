#pragma once

#include <cstdint>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/replay/timeline.hpp"
#include "libport/tape/tape_header.hpp"

namespace porttape {

// The clock that sessions of a replay begin on. A player's own is set anew by each session: the tape's time
// there is the time of the driver's open. A shared one is set by the first session of any of its players, and
// all others join it: what several tapes recorded at one time, they play at one time, whenever each driver
// opens. What the clock has passed already when a driver opens comes at once.
//
// It gives each session a Timeline. That is the session's own from then on: a gate that opens sets off what
// follows it on its own tape, and no other player's.
//
// A shared clock stops when the last run that has joined it leaves: the next session sets it anew. It must
// outlive its players. Not thread-safe: they are on one thread.
class ReplayClock {
 public:
  enum class Sessions : std::uint8_t { join, set_it };

  // `rate` > 0: tape time runs this many times as fast.
  explicit ReplayClock(double rate, Sessions sessions = Sessions::join)
      : timeline_(rate), rate_(rate), sessions_(sessions) {}

  // A session that plays from `tape` on begins at `now`.
  Timeline begin_session(TapeTime tape, Instant now) {
    if (!runs_ || sessions_ == Sessions::set_it) timeline_.anchor(tape, now);
    runs_ = true;
    return timeline_;
  }

  // A run begins, and ends; its sessions are in between.
  void join() { ++runs_joined_; }
  void leave() {
    if (--runs_joined_ == 0) runs_ = false;
  }

  // Where a tape with this zero begins, by the clock's tape time: the first one that asks, at 0.
  Micros tape_begin(const TapeZero& zero) {
    if (!first_zero_) first_zero_ = zero;
    return since(*first_zero_, zero).value_or(Micros{});
  }

  [[nodiscard]] bool runs() const { return runs_; }
  [[nodiscard]] double rate() const { return rate_; }
  // While it runs.
  [[nodiscard]] const Timeline& timeline() const { return timeline_; }

 private:
  Timeline timeline_;
  double rate_;
  Sessions sessions_;
  int runs_joined_ = 0;
  bool runs_ = false;
  std::optional<TapeZero> first_zero_;
};

// A player's place on a clock.
struct ClockPlace {
  ReplayClock& clock;
  Micros tape_begin{};  // when the player's tape begins, by the clock's tape time

  Timeline begin_session(TapeTime tape, Instant now) const {
    Timeline timeline = clock.begin_session(tape + tape_begin, now);
    timeline.anchor(timeline.anchor_tape() - tape_begin, timeline.anchor_real());
    return timeline;
  }
};

}  // namespace porttape
