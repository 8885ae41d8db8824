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
  // The driver has dropped what had come to it.
  void flushed() { flushes_ += delivered_ ? 1U : 0U; }
  void told(const line::LeftUnread& left) { told_ = left; }
  void close_session() {
    before_ += last_.value_or(0);
    last_ = told_ ? told_->bytes : std::nullopt;
    untold_ = untold_ || (delivered_ && !told_);
    unseen_ = unseen_ || (delivered_ && told_ && !told_->bytes);
    begin_session();
  }

  void add_to(RunReport& report) const {
    report.left_unread = last_;
    report.left_unread_before = before_;
    report.left_untold = untold_;
    report.left_unseen = unseen_;
    report.left_flushed = flushes_ > report.input_flushes;
  }

 private:
  bool delivered_ = false;  // in this session
  std::optional<line::LeftUnread> told_;
  std::optional<std::uint64_t> last_;  // at the latest close
  std::uint64_t before_ = 0;           // at the closes before
  std::uint64_t flushes_ = 0;          // behind deliveries of their session
  bool untold_ = false;                // a line did not tell
  bool unseen_ = false;                // a line that tells it otherwise could not
};

}  // namespace porttape
