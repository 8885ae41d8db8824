#pragma once

#include <algorithm>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/replay/gap_cuts.hpp"
#include "libport/replay/rate_changes.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/replay_config.hpp"
#include "libport/replay/timeline.hpp"

namespace porttape {

// When what comes next on the tape is due: the session's timeline, set off anew by what really happened, and
// never before what was played last. Idle gaps that are too long count as `max_gap`: tell it by reach() what
// the walk comes to. All instants are the clock's played time. Refers to its clock, which must outlive it.
class Pace {
 public:
  Pace(const ClockPlace& place, Timing timing, std::optional<Micros> max_gap)
      : place_(place), timing_(timing), cuts_(max_gap) {}

  // A session plays from `tape` on.
  void begin_session(TapeTime tape, Instant now) {
    timeline_ = place_.begin_session(tape, now);
    begin(tape, now);
  }
  // The same, on no other player's clock: the session goes on from there.
  void jump(TapeTime tape, Instant now) {
    timeline_ = Timeline(place_.clock.rate());
    timeline_.anchor(tape, now);
    begin(tape, now);
  }
  void reach(TapeTime tape) { cuts_.reach(tape); }
  // What was recorded at `tape` and due at `due` happened at `real`.
  void played(TapeTime tape, Instant due, Instant real) {
    last_ = {cuts_.cut(tape), real};
    floor_ = due;
  }
  // `tape` happened at `real`: what follows is timed from there, and nothing of it comes before `not_before`.
  void go_on_from(TapeTime tape, Instant real, Instant not_before) {
    anchor(tape, real);
    last_ = {cuts_.cut(tape), real};
    if (const auto changed = changes_.last_after(real)) last_ = {timeline_.tape(*changed), *changed};
    floor_ = std::max(floor_, not_before);
  }
  // The same at an open that the driver did not make: the next write is still timed from what was before it.
  void go_on_past_open(TapeTime tape, Instant real) {
    anchor(tape, real);
    floor_ = std::max(floor_, real);
  }
  // From `now` on.
  void set_rate(double rate, Instant now) {
    last_.tape += timeline_.since(last_.real, now);
    last_.real = std::max(last_.real, now);
    changes_.add(timeline_.rate(), now);
    timeline_.set_rate(rate, now);
  }
  // Nothing waits for its time.
  void hurry(bool on) { hurry_ = on; }

  [[nodiscard]] Instant due(TapeTime at) const {
    return timing_ == Timing::none || hurry_ ? floor_ : std::max(floor_, real(at));
  }
  // The recorded gap after what happened last.
  [[nodiscard]] Instant after_last(TapeTime at) const {
    return timeline_.after(last_.real, cuts_.cut(at) - last_.tape);
  }
  // The same, but no sooner than recorded where the replay is faster.
  [[nodiscard]] Instant unhurried_after_last(TapeTime at) const {
    return std::max(after_last(at), saturating_add(last_.real, cuts_.cut(at) - last_.tape));
  }
  // When `at` was due, but not before the driver really had what came before it.
  [[nodiscard]] Instant due_to_driver(TapeTime at) const { return std::max({floor_, real(at), last_.real}); }

  // By the session's timeline alone.
  [[nodiscard]] Instant real(TapeTime at) const { return timeline_.real(cuts_.cut(at)); }
  [[nodiscard]] TapeTime tape(Instant now) const { return cuts_.uncut(timeline_.tape(now)); }
  // The last due time, or what opened the last gate.
  [[nodiscard]] Instant floor() const { return floor_; }

  // How far a driver that goes by its own clock may be from the played time: that did not stand since the
  // session began, and was not moved.
  [[nodiscard]] ReplayClock::Shift shift() const {
    const ReplayClock::Shift now = place_.clock.shift();
    return {now.stood - begun_.stood, now.moved - begun_.moved};
  }
  // Where the walk has come to, if gaps behind it may be cut that are not known yet.
  [[nodiscard]] std::optional<TapeTime> cuts_known_to() const {
    return cuts_.any_possible() ? std::optional(cuts_.reached()) : std::nullopt;
  }
  [[nodiscard]] ReplayClock& clock() const { return place_.clock; }

 private:
  struct Event {
    TapeTime tape{};  // without what is cut
    Instant real{};
  };

  // `tape` happened at `real`, which may be before the latest changes of the rate: a driver may write ahead.
  void anchor(TapeTime tape, Instant real) {
    timeline_ = changes_.timeline_from(cuts_.cut(tape), real, timeline_.rate());
  }
  void begin(TapeTime tape, Instant now) {
    changes_.forget();
    cuts_.begin(tape);
    begun_ = place_.clock.shift();
    last_ = {tape, now};
    floor_ = now;
  }
  ClockPlace place_;
  Timing timing_;
  Timeline timeline_{place_.clock.rate()};
  GapCuts cuts_;
  bool hurry_ = false;
  Instant floor_{};
  ReplayClock::Shift begun_;  // when the session did
  RateChanges changes_;       // since then
  Event last_;
};

}  // namespace porttape
