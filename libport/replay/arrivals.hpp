#pragma once

#include <cstdint>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/replay/replay_config.hpp"
#include "libport/replay/schedule.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// Whether blocks that follow each other closely are joined.
constexpr bool joins_bursts(Chunks chunks, bool stamped_at_arrival) {
  return chunks == Chunks::burst || (chunks != Chunks::recorded && !stamped_at_arrival);
}

// Which recorded reads came to the driver as one: the pieces of a block, and, with `bursts`, blocks less than
// `burst_gap` apart with nothing between them. Ask by look() about the read at the head of a walk.
class Arrivals {
 public:
  Arrivals(bool bursts, Micros burst_gap) : bursts_(bursts), burst_gap_(burst_gap) {}

  void rewind() {
    looked_at_.reset();
    started_ = false;
  }

  void look(const Record& head, const Schedule& schedule) {
    look(head, schedule.records_passed(), schedule.breaks_passed());
  }
  // `number` of the record, and how many there were before it that end an arrival.
  void look(const Record& head, std::uint64_t number, std::uint64_t breaks) {
    if (looked_at_ == number) return;
    looked_at_ = number;
    const bool goes_on = started_ && breaks_ == breaks;
    const bool joins = bursts_ && goes_on && head.at - last_ < burst_gap_ && head.at - first_ < kLongestBurst;
    continues_ = joins || (goes_on && head.piece_offset > 0);
    if (!continues_) first_ = head.at;
    last_ = head.at;
    breaks_ = breaks;
    started_ = true;
  }
  // A part of the read at the head was delivered: its rest goes on with that.
  void delivered_part() { continues_ = true; }

  // Of the arrival that the read belongs to.
  [[nodiscard]] TapeTime first() const { return first_; }
  // Whether the read goes on with what was delivered before it.
  [[nodiscard]] bool continues() const { return continues_; }

 private:
  // A burst is cut here, so that a stream of single bytes without a pause still plays in time.
  static constexpr Micros kLongestBurst{100'000};

  bool bursts_;
  Micros burst_gap_;
  std::optional<std::uint64_t> looked_at_;  // number of the record
  std::uint64_t breaks_ = 0;                // on the tape, before the arrival
  bool started_ = false;
  bool continues_ = false;
  TapeTime first_{};
  TapeTime last_{};
};

}  // namespace porttape
