#pragma once

#include <optional>

#include "libport/base/result.hpp"
#include "libport/line/line_settings.hpp"
#include "libport/tty/tty.hpp"

namespace porttape {

// The settings of a pty's slave, seen and made through its master: speeds, stop bits and flow control. The
// kernel's pty driver hides the rest (it forces 8 data bits and no parity).
//
// Debian's tcsetattr fails with EINVAL where a request has parity or 5 to 7 data bits and the line shows the
// same before and after it. So that something always differs, the line shows CLOCAL cleared, which means
// nothing on a pty and which drivers set. TIOCSSOFTCAR clears it in one step, so that no setting that a
// driver makes at that moment is undone. Not before the driver has moved on: tcsetattr itself reads back at
// once, and some programs (stty) do. So it is cleared again when the driver flushes or closes (by
// UrgentEvents, within microseconds: pyserial sets its line, flushes, and may set it again), writes, or has
// left its line alone since the last look. Two such requests in a row, with nothing between them, still fail.
//
// For drivers that leave CLOCAL alone, IGNBRK is set again too: many clear it (cfmakeraw does), and it has no
// effect, because no break ever comes to a pty. A flag of echoing (ECHONL) cannot take this part: it acts as
// soon as the driver turns on ICANON. Setting IGNBRK takes two steps, so it is done only for these drivers.
//
// Uses the descriptor that it was made for, and does not own it.
class PtySettings {
 public:
  explicit PtySettings(int master) : master_(master) {}

  // Makes the line so, for a driver that is to find it so, whatever it set before.
  Result<void> show(const LineSettings& settings);
  // The line as it is counts as known.
  void take_as_known();

  // Another driver has it, which found it so (none: as it is).
  void assume(const std::optional<LineSettings>& settings);

  // What the line shows, where that has changed since the last call and the last show(). `moved_on`: the
  // driver has done something since it set its line.
  [[nodiscard]] std::optional<SeenSettings> look(bool moved_on);

 private:
  void keep_changeable(const ShownSettings& shown, bool moved_on);

  int master_;
  SeenSettings known_;
  // At the last look.
  bool clocal_set_ = false;
  bool ignbrk_cleared_ = false;
  bool sets_clocal_ = false;  // this driver does
};

}  // namespace porttape
