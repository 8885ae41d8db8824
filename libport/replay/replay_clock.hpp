#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/replay/hand_moves.hpp"
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
// It can stand still: all that its players know of time is `played` time, which is the real one without the
// times at which it stood. While it stands it can be moved forward by hand. That is so for all its players;
// their next deadlines are other ones then.
//
// A shared clock stops when the last run that has joined it leaves: the next session sets it anew. It must
// outlive its players. Not thread-safe: they are on one thread.
class ReplayClock {
 public:
  enum class Sessions : std::uint8_t { join, set_it };

  // `rate` > 0: tape time runs this many times as fast.
  explicit ReplayClock(double rate, Sessions sessions = Sessions::join)
      : timeline_(rate), sessions_(sessions) {}

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

  // From `now` (played) on; sessions that have begun set their own timelines.
  void set_rate(double rate, Instant now) { timeline_.set_rate(rate, now); }

  // It stands from the real time `now` on, until it goes on.
  void stand(Instant now) {
    const Instant at = played(now);
    if (stands_at_) return;
    stood_since_ = now;
    stands_at_ = at;
    ++changes_;
  }
  void go_on(Instant now) {
    if (!stands_at_) return;
    const Instant at = played(now);
    shift_.stood += real_ - stood_since_;
    behind_ = real_ - at;
    stands_at_.reset();
    ++changes_;
  }
  // How often it stopped or went on.
  [[nodiscard]] std::uint64_t changes() const { return changes_; }
  [[nodiscard]] bool stands() const { return stands_at_.has_value(); }
  // While it stands: forward to that played time, if it is not there.
  void move_to(Instant played) {
    if (!stands_at_ || played <= *stands_at_) return;
    shift_.moved += played - *stands_at_;
    moves_.add(*stands_at_, played);
    stands_at_ = played;
  }
  // When, by the played time, nobody has done anything for `silence` since `since`: what it was moved by hand
  // since then is no silence. A later move makes it later.
  [[nodiscard]] Instant silent(Instant since, Nanos silence) const { return moves_.after(since, silence); }

  // The played time at the real time `now`, which never goes back.
  Instant played(Instant now) {
    real_ = std::max(real_, now);
    return stands_at_ ? *stands_at_ : now - behind_;
  }
  // When that played time is, by the real clock; nothing where the clock stands before it.
  [[nodiscard]] std::optional<Instant> real(Instant played) const {
    if (!stands_at_) return saturating_add(played, behind_);
    return played <= *stands_at_ ? std::optional(stood_since_) : std::nullopt;
  }

  // How far the played time has come apart from the real one by the last time that was told: for so long it
  // stood, and so far it was moved. Both only grow.
  struct Shift {
    Nanos stood{};
    Nanos moved{};
    [[nodiscard]] Nanos both() const { return stood - moved; }
  };
  [[nodiscard]] Shift shift() const {
    return {shift_.stood + (stands_at_ ? real_ - stood_since_ : Nanos{}), shift_.moved};
  }

  [[nodiscard]] bool runs() const { return runs_; }
  [[nodiscard]] double rate() const { return timeline_.rate(); }
  // While it runs.
  [[nodiscard]] const Timeline& timeline() const { return timeline_; }

 private:
  Timeline timeline_;
  Sessions sessions_;
  int runs_joined_ = 0;
  bool runs_ = false;
  std::optional<TapeZero> first_zero_;
  Instant real_{};                    // the latest that was told
  Nanos behind_{};                    // the played time, while it goes on
  std::optional<Instant> stands_at_;  // played
  Instant stood_since_{};             // real
  Shift shift_;
  HandMoves moves_;
  std::uint64_t changes_ = 0;
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
