#include "libport/tty/tty.hpp"

#include <algorithm>
#include <array>
#include <asm/termbits.h>  // termios2; not to be mixed with <termios.h>
#include <cerrno>
#include <filesystem>
#include <fmt/format.h>
#include <sys/ioctl.h>
#include <sys/sysmacros.h>
#include <utility>

namespace porttape {
namespace {

// The majors of pty slaves (Linux Documentation/admin-guide/devices.txt).
constexpr unsigned kFirstPtsMajor = 136;
constexpr unsigned kLastPtsMajor = 143;

constexpr std::array<tcflag_t, 4> kDataBitFlags = {CS5, CS6, CS7, CS8};

struct Rate {
  unsigned baud;
  tcflag_t code;
};
constexpr std::array<Rate, 28> kStandardRates = {
    {{50, B50},           {75, B75},           {110, B110},         {134, B134},         {150, B150},
     {200, B200},         {300, B300},         {600, B600},         {1200, B1200},       {1800, B1800},
     {2400, B2400},       {4800, B4800},       {9600, B9600},       {19200, B19200},     {38400, B38400},
     {57600, B57600},     {115200, B115200},   {230400, B230400},   {460800, B460800},   {500000, B500000},
     {576000, B576000},   {921600, B921600},   {1000000, B1000000}, {1152000, B1152000}, {1500000, B1500000},
     {2000000, B2000000}, {3000000, B3000000}, {4000000, B4000000}}};

// A standard rate by its own code, since older programs that look at the line know no other.
tcflag_t rate_code(unsigned baud) {
  const auto* const rate = std::ranges::find(kStandardRates, baud, &Rate::baud);
  return rate == kStandardRates.end() ? static_cast<tcflag_t>(BOTHER) : rate->code;
}

Error tty_error(std::string_view what) {
  return make_error(Errc::io, fmt::format("{}: {}", what, errno_text(errno)));
}

void set_raw_flags(termios2& tio) {
  tio.c_iflag &= ~static_cast<tcflag_t>(IGNBRK | BRKINT | PARMRK | ISTRIP | INLCR | IGNCR | ICRNL | IXON |
                                        IXOFF | IXANY | INPCK);
  tio.c_oflag &= ~static_cast<tcflag_t>(OPOST);
  tio.c_lflag &= ~static_cast<tcflag_t>(ECHO | ECHOE | ECHOK | ECHONL | ICANON | ISIG | IEXTEN);
  tio.c_cc[VMIN] = 1;
  tio.c_cc[VTIME] = 0;
}

termios2 with_settings(termios2 tio, const LineSettings& wanted) {
  set_raw_flags(tio);
  tio.c_cflag &= ~static_cast<tcflag_t>(CSIZE | CSTOPB | PARENB | PARODD | CMSPAR | CRTSCTS | CBAUD |
                                        (CBAUD << IBSHIFT));
  tio.c_cflag |= CREAD | CLOCAL | rate_code(wanted.baud) | kDataBitFlags[wanted.data_bits - 5];
  if (wanted.stop_bits == 2) tio.c_cflag |= CSTOPB;
  if (wanted.parity != Parity::none) tio.c_cflag |= PARENB;
  if (wanted.parity == Parity::odd) tio.c_cflag |= PARODD;
  if (wanted.hw_flow) tio.c_cflag |= CRTSCTS;
  if (wanted.sw_flow) tio.c_iflag |= IXON | IXOFF;
  tio.c_ispeed = wanted.baud;
  tio.c_ospeed = wanted.baud;
  return tio;
}

bool rate_close(unsigned got, unsigned wanted) {
  const std::uint64_t difference = got > wanted ? got - wanted : wanted - got;
  return difference * 100 <= std::uint64_t{wanted} * 3;
}

}  // namespace

Result<std::string> apply_settings(int fd, const LineSettings& settings) {
  termios2 tio{};
  if (::ioctl(fd, TCGETS2, &tio) != 0) return tty_error("reading the line settings");
  const termios2 wanted = with_settings(tio, settings);
  if (::ioctl(fd, TCSETS2, &wanted) != 0) return tty_error("setting the line");
  termios2 got{};
  if (::ioctl(fd, TCGETS2, &got) != 0) return tty_error("reading the line settings back");
  if (!rate_close(got.c_ospeed, settings.baud)) {
    return make_error(Errc::device_missing,
                      fmt::format("the device does not do {} baud (it took {}): choose a rate it can do",
                                  settings.baud, got.c_ospeed));
  }
  std::string not_taken;
  const auto check = [&](tcflag_t mask, std::string_view what) {
    if ((got.c_cflag & mask) == (wanted.c_cflag & mask)) return;
    if (!not_taken.empty()) not_taken += ", ";
    not_taken += what;
  };
  check(PARENB | PARODD, "parity");
  check(CSIZE, "data bits");
  check(CSTOPB, "stop bits");
  check(CRTSCTS, "hwflowctrl");
  return not_taken;
}

Result<void> make_pty_raw(int fd) {
  termios2 tio{};
  if (::ioctl(fd, TCGETS2, &tio) != 0) return tty_error("reading the pty's settings");
  set_raw_flags(tio);
  tio.c_lflag |= ECHONL;
  tio.c_cflag |= CREAD | CLOCAL;
  if (::ioctl(fd, TCSETS2, &tio) != 0) return tty_error("making the pty raw");
  return {};
}

void set_echonl_again(int fd) {
  termios2 tio{};
  if (::ioctl(fd, TCGETS2, &tio) != 0 || (tio.c_lflag & (ICANON | ECHONL)) != 0) return;
  tio.c_lflag |= ECHONL;
  (void)::ioctl(fd, TCSETS2, &tio);
}

Result<void> set_modem_line(int fd, int line, bool on) {
  if (::ioctl(fd, on ? TIOCMBIS : TIOCMBIC, &line) != 0) return tty_error("setting a modem line");
  return {};
}

std::optional<bool> is_tty_device(std::uint64_t device) {
  const unsigned major_number = gnu_dev_major(device);
  if (major_number >= kFirstPtsMajor && major_number <= kLastPtsMajor) return true;
  std::error_code error;
  const auto subsystem = std::filesystem::read_symlink(
      fmt::format("/sys/dev/char/{}:{}/subsystem", major_number, gnu_dev_minor(device)), error);
  if (!error) return subsystem.filename() == "tty";
  if (std::filesystem::exists("/sys/dev/char", error)) return false;
  return std::nullopt;
}

}  // namespace porttape
