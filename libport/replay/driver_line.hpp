#pragma once

#include <cstdint>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/replay/gate.hpp"
#include "libport/replay/line_step.hpp"
#include "libport/replay/matcher.hpp"
#include "libport/replay/pace.hpp"
#include "libport/replay/schedule.hpp"
#include "libport/replay/tape_sessions.hpp"

namespace porttape {

// The line of a driver that the tape plays: when it opens, sets, flushes and closes it, and how the device
// may end it. Each step is due as a write of the driver's is: once the device has answered what precedes it
// on the tape, the recorded gap later.
//
// At the tape's last close the device is listened to for kLinger longer, for what it says too much; a device
// that streams there always has more to say (streams_on()).
//
// Told by the walk of what it stands at and passes, in order. Refers to the walk's parts, which must outlive
// it.
class DriverLine {
 public:
  static constexpr Nanos kLinger = std::chrono::milliseconds(200);

  // What became of the record at the head: it is done with, or is to be looked at again, at `until` or when
  // something happened.
  struct Answer {
    bool done = false;
    std::optional<Instant> until{};
  };

  DriverLine(const ReplayConfig& config, Schedule& schedule, Gate& gate, Pace& pace, TapeSessions& sessions)
      : lingers_(config.strictness > 0), schedule_(schedule), gate_(gate), pace_(pace), sessions_(sessions) {}

  // A run begins, with the line open.
  void begin() {
    open_ = true;
    opening_ = false;
    all_came_.reset();
    answered();
  }
  // The line that open() gave as a step is there.
  void opened() {
    open_ = true;
    opening_ = false;
  }
  // The device has ended it.
  void ended() { open_ = false; }
  [[nodiscard]] bool is_open() const { return open_; }
  [[nodiscard]] bool opening() const { return opening_; }

  // Bytes are written to the device; and the walk passes what it sent at `at`.
  void answered() {
    latest_.reset();
    pause_ = Micros{0};
  }
  void pass_answer(TapeTime at);

  // At an open, a close, and any other event of the head; what is to be done is put into `step`.
  Answer at_open(Instant now, std::optional<LineStep>& step);
  Answer at_close(Instant now, std::optional<LineStep>& step);
  Answer at_event(Instant now, std::optional<LineStep>& step);
  // At the tape's end, which is then `at`.
  Answer at_end(Instant now);

  // Whether the bytes after the last write come with pauses up to where the tape ends, so that more of them
  // tell nothing.
  [[nodiscard]] bool streams_on() const { return streams_on_; }

 private:
  // Shorter pauses are within one answer.
  static constexpr Micros kPause{2'000};

  Answer wait_until_due(Instant now, TapeTime at);
  static Answer wait_until(Instant now, Instant due);
  Instant heard_out(Instant now, TapeTime at);

  bool lingers_;
  Schedule& schedule_;
  Gate& gate_;
  Pace& pace_;
  TapeSessions& sessions_;

  bool open_ = true;
  bool opening_ = false;
  bool streams_on_ = false;
  std::optional<Instant> all_came_;  // that the tape's last session has
  std::optional<TapeTime> latest_;   // of the device's blocks since the driver's last
  Micros pause_{};                   // the longest between two of them
};

}  // namespace porttape
