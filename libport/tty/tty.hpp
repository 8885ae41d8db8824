#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <optional>
#include <string>

#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "libport/line/line_settings.hpp"

namespace porttape {

// What a tty was asked for and what it took of that.
struct TakenSettings {
  LineSettings settings;  // as read back; parity and data bits as asked for, since not every tty shows them
  std::string not_taken;  // names what is otherwise than asked for; empty: nothing
};

// Makes the tty raw with these settings and reads them back, since drivers fall back silently (an 8250 takes
// 9600 for a rate it cannot do). A rate more than 3 % off is an error, and leaves the line as the device made
// it. Can wait for the device.
Result<TakenSettings> apply_settings(int fd, const LineSettings& settings);

// Waits until what was written has left the device, UART included, as long as that gets on: the line may be
// stopped. False: it did not get on for `patience`, or for a second where somebody is in a hurry. For another
// thread than the loop's.
bool wait_until_sent(int fd, Nanos patience, const std::atomic<bool>& hurry);

// Lowers DTR and RTS where a close would (HUPCL).
void lower_modem_lines(int fd);

// Makes a pty raw (no echo, no translation, VMIN 1), speeds and the rest kept. Through the master or a slave
// descriptor. Leaves CLOCAL cleared and IGNBRK set: neither does anything on a pty in any mode, since a pty
// has no carrier and carries no breaks, and drivers change both (PtySettings has what that is good for).
Result<void> make_pty_raw(int fd);

// All that is set of a tty, for comparison.
struct TtyState {
  std::array<unsigned char, 64> bytes{};
};
Result<TtyState> tty_state(int fd);

// As make_pty_raw(), and with these settings where there are any, in one step. A line that shows something
// else than `since` has been set by a program meanwhile, and is left as it is (CLOCAL does not count).
Result<void> make_pty_fresh(int fd, const TtyState& since, const std::optional<LineSettings>& settings);

// What a tty's descriptor, or a pty's master, shows without parity and data bits.
struct ShownSettings {
  SeenSettings settings;
  bool clocal = false;
  bool ignbrk_cleared = false;
};
Result<ShownSettings> shown_settings(int fd);

// Makes a pty's speeds, stop bits and flow control so, and leaves the rest.
Result<void> show_settings(int master, const LineSettings& settings);

// Sets IGNBRK of a pty.
void set_ignbrk(int master);

// Clears CLOCAL of a pty in one step: nothing else that is set at that moment is undone.
void clear_clocal(int master);

// Sets or clears a modem line (TIOCM_DTR, TIOCM_RTS). Ptys have none: ENOTTY.
Result<void> set_modem_line(int fd, int line, bool on);

// Whether this character device is a tty, told without opening it (opening raises DTR). `device` is its
// st_rdev. Unknown where there is no sysfs.
std::optional<bool> is_tty_device(std::uint64_t device);

}  // namespace porttape
