#pragma once

#include <cstdint>

#include "libport/base/time.hpp"
#include "libport/replay/timeline.hpp"

namespace porttape {

// The clock that sessions of a replay begin on. A player's own is set anew by each session: the tape's time
// there is the time of the driver's open. A shared one is set by the first session of any of its players, and
// all others join it: what several tapes recorded at one time, they play at one time, whenever each driver
// opens. What the clock has passed already when a driver opens comes at once.
//
// It gives each session a Timeline. That is the session's own from then on: a gate that opens sets off what
// follows it on its own tape, and no other player's.
//
// A shared clock is kept by whoever made the players: stop() between their runs. Not thread-safe: its players
// are on one thread.
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

  // The next session sets it.
  void stop() { runs_ = false; }

  [[nodiscard]] bool runs() const { return runs_; }
  [[nodiscard]] double rate() const { return rate_; }
  // While it runs.
  [[nodiscard]] const Timeline& timeline() const { return timeline_; }

 private:
  Timeline timeline_;
  double rate_;
  Sessions sessions_;
  bool runs_ = false;
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
