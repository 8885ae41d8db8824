#pragma once

#include <algorithm>

#include "libport/base/time.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/replay_config.hpp"
#include "libport/replay/timeline.hpp"

namespace porttape {

// When what comes next on the tape is due: the session's timeline, set off anew by what really happened, and
// never before what was played last. Refers to its clock, which must outlive it.
class Pace {
 public:
  Pace(const ClockPlace& place, Timing timing) : place_(place), timing_(timing) {}

  // A session plays from `tape` on.
  void begin_session(TapeTime tape, Instant now) {
    timeline_ = place_.begin_session(tape, now);
    last_ = {tape, now};
    floor_ = now;
  }
  // What was recorded at `tape` and due at `due` happened at `real`.
  void played(TapeTime tape, Instant due, Instant real) {
    last_ = {tape, real};
    floor_ = due;
  }
  // `tape` happened at `real`: what follows is timed from there, and nothing of it comes before `not_before`.
  void go_on_from(TapeTime tape, Instant real, Instant not_before) {
    timeline_.anchor(tape, real);
    last_ = {tape, real};
    floor_ = std::max(floor_, not_before);
  }
  // The same at an open that the driver did not make: the next write is still timed from what was before it.
  void go_on_past_open(TapeTime tape, Instant real) {
    timeline_.anchor(tape, real);
    floor_ = std::max(floor_, real);
  }

  [[nodiscard]] Instant due(TapeTime at) const {
    return timing_ == Timing::none ? floor_ : std::max(floor_, timeline_.real(at));
  }
  // The recorded gap after what happened last.
  [[nodiscard]] Instant after_last(TapeTime at) const { return timeline_.after(last_.real, at - last_.tape); }
  // When `at` was due, but not before the driver really had what came before it.
  [[nodiscard]] Instant due_to_driver(TapeTime at) const {
    return std::max({floor_, timeline_.real(at), last_.real});
  }

  [[nodiscard]] const Timeline& timeline() const { return timeline_; }

 private:
  struct Event {
    TapeTime tape{};
    Instant real{};
  };

  ClockPlace place_;
  Timing timing_;
  Timeline timeline_{place_.clock.rate()};
  Instant floor_{};  // the last due time, or what opened the last gate
  Event last_;
};

}  // namespace porttape
