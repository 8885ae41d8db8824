#pragma once

#include "libport/base/time.hpp"

namespace porttape {

// Maps tape time to real time: an anchor (one tape time and the real instant it was) and a rate. A due time
// is always computed from the anchor, never by adding up gaps, so errors do not accumulate.
//
// A value; no errors: results that no Instant can hold are cut to the farthest one. Real times are rounded up
// to the next nanosecond, so what is played by them is never early.
class Timeline {
 public:
  // `rate` > 0: tape time runs this many times as fast.
  explicit Timeline(double rate) : rate_(rate) {}

  void anchor(TapeTime tape, Instant real) {
    tape_ = tape;
    real_ = real;
  }
  // From `now` on time runs at another rate; what was played by then stays so.
  void set_rate(double rate, Instant now) {
    anchor(tape(now), now);
    rate_ = rate;
  }

  [[nodiscard]] Instant real(TapeTime tape) const { return after(real_, tape - tape_); }
  [[nodiscard]] TapeTime tape(Instant real) const;

  // How much of the tape goes by from one to the other, rounded down.
  [[nodiscard]] Micros since(Instant from, Instant to) const;

  // `start` plus a gap of the tape.
  [[nodiscard]] Instant after(Instant start, Micros tape_gap) const;

  [[nodiscard]] TapeTime anchor_tape() const { return tape_; }
  [[nodiscard]] Instant anchor_real() const { return real_; }
  [[nodiscard]] double rate() const { return rate_; }

 private:
  double rate_;
  TapeTime tape_{};
  Instant real_{};
};

// `start` plus `gap`, cut to the farthest Instant.
Instant saturating_add(Instant start, Nanos gap);

}  // namespace porttape
