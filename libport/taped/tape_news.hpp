#pragma once

#include <string>

#include "libport/base/time.hpp"
#include "libport/port/context.hpp"
#include "libport/tape/live_tape.hpp"

namespace porttape {

// Tells the log what befalls a tape that is being recorded, each thing once a tape, a failure at most once a
// second. Loop thread only.
//
// Drive it: begin() for each tape; then look() at its status when there is something new, failure() when a
// block could not be written or can again, and silence() from time to time.
class TapeNews {
 public:
  // `tape` is its name; `fail_closed`: the line is to end with a failure, as the log then says.
  TapeNews(const PortContext& context, std::string tape, bool fail_closed)
      : context_(context), tape_(std::move(tape)), fail_closed_(fail_closed) {}

  void begin() { told_ = {}; }

  struct Found {
    bool made = false;         // just now
    bool sync_failed = false;  // just now: the tape is not complete
    bool fails = false;        // it is to be ended, where fail_closed is asked for
  };
  Found look(const LiveTape::Status& status);
  // True where it fails, and that was told now.
  bool failure(const LiveTape::Status& status);
  // No event tells that a disk does not answer. True where it is to be ended with fail_closed.
  bool silence(const LiveTape::Status& status);

  [[nodiscard]] bool failing() const { return told_.failing; }
  [[nodiscard]] bool sync_failed() const { return told_.sync; }

 private:
  PortContext context_;
  std::string tape_;
  bool fail_closed_;
  struct Told {
    bool made = false;
    bool slow = false;
    bool sync = false;
    bool silence = false;
    bool failing = false;
    bool failure = false;
  };
  Told told_;  // of this tape
  Instant next_telling_{};
};

}  // namespace porttape
