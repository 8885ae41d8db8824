#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "libport/base/result.hpp"
#include "libport/port/line_settings.hpp"

namespace porttape {

// Makes the tty raw with these settings and reads them back, since drivers fall back silently (an 8250 takes
// 9600 for a rate it cannot do). A rate more than 3 % off is an error; a pty that cannot hold parity or 5 to
// 7 bits is not, it is named in the string returned (empty: all was taken).
Result<std::string> apply_settings(int fd, const LineSettings& settings);

// Makes a pty raw (no echo, no translation, VMIN 1), speeds and the rest kept. Through the master or a slave
// descriptor. Leaves ECHONL set, which does nothing while ICANON is off: some C libraries fail tcsetattr with
// EINVAL when a request changes nothing that sticks, and a pty takes neither parity nor 5 to 7 bits; clearing
// that bit is a change that sticks.
Result<void> make_pty_raw(int fd);

// Sets ECHONL again after a driver has cleared it, if ICANON is off. Cheap when there is nothing to do.
void set_echonl_again(int fd);

// Sets or clears a modem line (TIOCM_DTR, TIOCM_RTS). Ptys have none: ENOTTY.
Result<void> set_modem_line(int fd, int line, bool on);

// Whether this character device is a tty, told without opening it (opening raises DTR). `device` is its
// st_rdev. Unknown where there is no sysfs.
std::optional<bool> is_tty_device(std::uint64_t device);

}  // namespace porttape
