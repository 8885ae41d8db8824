#pragma once

#include <cstdint>
#include <optional>

#include "libport/line/line_event.hpp"
#include "libport/replay/report.hpp"

namespace porttape {

// What a run's drivers left unread when they closed, summed over the sessions of the run. A driver to which
// nothing was delivered in a session has left nothing there.
//
// Drive it: begin_run(), then begin_session() at each open, and close_session() at each close, behind the
// told() that the line may have for it.
class UnreadTally {
 public:
  void begin_run() { *this = {}; }
  void begin_session() {
    delivered_ = false;
    told_.reset();
  }
  void delivered() { delivered_ = true; }
  void told(const line::LeftUnread& left) { told_ = left; }
  void close_session() {
    before_ += last_.value_or(0);
    last_ = told_ ? std::optional(told_->bytes) : std::nullopt;
    untold_ = untold_ || (delivered_ && !told_);
    begin_session();
  }

  void add_to(RunReport& report) const {
    report.left_unread = last_;
    report.left_unread_before = before_;
    report.left_untold = untold_;
  }

 private:
  bool delivered_ = false;  // in this session
  std::optional<line::LeftUnread> told_;
  std::optional<std::uint64_t> last_;  // at the latest close
  std::uint64_t before_ = 0;           // at the closes before
  bool untold_ = false;                // a line did not tell
};

}  // namespace porttape
