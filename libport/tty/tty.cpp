#include "libport/tty/tty.hpp"

#include <algorithm>
#include <array>
#include <asm/termbits.h>  // termios2; not to be mixed with <termios.h>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fmt/format.h>
#include <sys/ioctl.h>
#include <sys/sysmacros.h>
#include <thread>
#include <utility>

#include "libport/base/clock.hpp"

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
constexpr std::array<Rate, 29> kStandardRates = {{{0, B0},
                                                  {50, B50},
                                                  {75, B75},
                                                  {110, B110},
                                                  {134, B134},
                                                  {150, B150},
                                                  {200, B200},
                                                  {300, B300},
                                                  {600, B600},
                                                  {1200, B1200},
                                                  {1800, B1800},
                                                  {2400, B2400},
                                                  {4800, B4800},
                                                  {9600, B9600},
                                                  {19200, B19200},
                                                  {38400, B38400},
                                                  {57600, B57600},
                                                  {115200, B115200},
                                                  {230400, B230400},
                                                  {460800, B460800},
                                                  {500000, B500000},
                                                  {576000, B576000},
                                                  {921600, B921600},
                                                  {1000000, B1000000},
                                                  {1152000, B1152000},
                                                  {1500000, B1500000},
                                                  {2000000, B2000000},
                                                  {3000000, B3000000},
                                                  {4000000, B4000000}}};

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

// What a pty shows of them too.
void set_visible(termios2& tio, const LineSettings& wanted) {
  tio.c_cflag &= ~static_cast<tcflag_t>(CSTOPB | CRTSCTS | CBAUD | (CBAUD << IBSHIFT));
  tio.c_iflag &= ~static_cast<tcflag_t>(IXON | IXOFF);
  tio.c_cflag |= rate_code(wanted.baud);
  if (wanted.stop_bits == 2) tio.c_cflag |= CSTOPB;
  if (wanted.hw_flow) tio.c_cflag |= CRTSCTS;
  if (wanted.sw_flow) tio.c_iflag |= IXON | IXOFF;
  tio.c_ispeed = wanted.baud;
  tio.c_ospeed = wanted.baud;
}

termios2 with_settings(termios2 tio, const LineSettings& wanted) {
  set_raw_flags(tio);
  set_visible(tio, wanted);
  tio.c_cflag &= ~static_cast<tcflag_t>(CSIZE | PARENB | PARODD | CMSPAR);
  tio.c_cflag |= CREAD | CLOCAL | kDataBitFlags[wanted.data_bits - 5];
  if (wanted.parity != Parity::none) tio.c_cflag |= PARENB;
  if (wanted.parity == Parity::odd || wanted.parity == Parity::mark) tio.c_cflag |= PARODD;
  if (wanted.parity == Parity::mark || wanted.parity == Parity::space) tio.c_cflag |= CMSPAR;
  return tio;
}

// XON/XOFF in one direction alone is the driver's own affair: its end of the pty does that.
bool has_sw_flow(const termios2& tio) { return (tio.c_iflag & IXON) != 0 && (tio.c_iflag & IXOFF) != 0; }

void set_pty_raw(termios2& tio) {
  set_raw_flags(tio);
  tio.c_iflag |= IGNBRK;
  tio.c_cflag |= CREAD;
  tio.c_cflag &= ~static_cast<tcflag_t>(CLOCAL);
}

TtyState state_of(termios2 tio) {
  tio.c_cflag &= ~static_cast<tcflag_t>(CLOCAL);
  TtyState state;
  static_assert(sizeof tio <= sizeof state.bytes);
  std::memcpy(state.bytes.data(), &tio, sizeof tio);
  return state;
}

bool rate_close(unsigned got, unsigned wanted) {
  const std::uint64_t difference = got > wanted ? got - wanted : wanted - got;
  return difference * 100 <= std::uint64_t{wanted} * 3;
}

}  // namespace

Result<TakenSettings> apply_settings(int fd, const LineSettings& settings) {
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
  TakenSettings taken{settings, {}};
  taken.settings.stop_bits = (got.c_cflag & CSTOPB) != 0 ? 2 : 1;
  taken.settings.hw_flow = (got.c_cflag & CRTSCTS) != 0;
  taken.settings.sw_flow = has_sw_flow(got);
  const auto check = [&](bool same, std::string_view what) {
    if (same) return;
    if (!taken.not_taken.empty()) taken.not_taken += ", ";
    taken.not_taken += what;
  };
  const auto same_flags = [&](tcflag_t mask) { return (got.c_cflag & mask) == (wanted.c_cflag & mask); };
  check(same_flags(PARENB | PARODD | CMSPAR), "parity");
  check(same_flags(CSIZE), "data bits");
  check(taken.settings.stop_bits == settings.stop_bits, "stop bits");
  check(taken.settings.hw_flow == settings.hw_flow, "hwflowctrl");
  check(taken.settings.sw_flow == settings.sw_flow, "swflowctrl");
  return taken;
}

bool wait_until_sent(int fd, Nanos patience, const std::atomic<bool>& hurry) {
  using std::chrono::milliseconds;
  constexpr int kFifo = 64;  // characters that leave TIOCOUTQ at once, at most
  termios2 tio{};
  if (::ioctl(fd, TCGETS2, &tio) != 0) return false;
  const unsigned baud = tio.c_ospeed;
  if (baud == 0) return false;                                        // hung up: it sends nothing
  const Nanos shortest = milliseconds(1000 + kFifo * 12'000 / baud);  // a character is 12 bits at most
  int left = 0;
  if (::ioctl(fd, TIOCOUTQ, &left) != 0) return false;
  auto got_on = machine_clock().now();
  for (int before = left; ::ioctl(fd, TIOCOUTQ, &left) == 0 && left > 0; before = left) {
    const auto now = machine_clock().now();
    if (left != before) got_on = now;
    if (now - got_on >= (hurry ? shortest : std::max(shortest, patience))) return false;
    std::this_thread::sleep_for(milliseconds(2));
  }
  // The UART's own. Nothing that can be stopped is left, so that this ends.
  return ::ioctl(fd, TCSBRK, 1) == 0;
}

void lower_modem_lines(int fd) {
  termios2 tio{};
  if (::ioctl(fd, TCGETS2, &tio) != 0 || (tio.c_cflag & HUPCL) == 0) return;
  const int lines = TIOCM_DTR | TIOCM_RTS;
  (void)::ioctl(fd, TIOCMBIC, &lines);
}

Result<void> make_pty_raw(int fd) {
  termios2 tio{};
  if (::ioctl(fd, TCGETS2, &tio) != 0) return tty_error("reading the pty's settings");
  set_pty_raw(tio);
  if (::ioctl(fd, TCSETS2, &tio) != 0) return tty_error("making the pty raw");
  return {};
}

Result<TtyState> tty_state(int fd) {
  termios2 tio{};
  if (::ioctl(fd, TCGETS2, &tio) != 0) return tty_error("reading the pty's settings");
  return state_of(tio);
}

Result<void> make_pty_fresh(int fd, const TtyState& since, const std::optional<LineSettings>& settings) {
  termios2 tio{};
  if (::ioctl(fd, TCGETS2, &tio) != 0) return tty_error("reading the pty's settings");
  if (state_of(tio).bytes != since.bytes) return {};
  set_pty_raw(tio);
  if (settings) set_visible(tio, *settings);
  if (::ioctl(fd, TCSETS2, &tio) != 0) return tty_error("making the pty raw");
  return {};
}

Result<ShownSettings> shown_settings(int fd) {
  termios2 tio{};
  if (::ioctl(fd, TCGETS2, &tio) != 0) return tty_error("reading the line settings");
  return ShownSettings{.settings = {.baud = tio.c_ospeed,
                                    .stop_bits = (tio.c_cflag & CSTOPB) != 0 ? 2U : 1U,
                                    .hw_flow = (tio.c_cflag & CRTSCTS) != 0,
                                    .sw_flow = has_sw_flow(tio)},
                       .clocal = (tio.c_cflag & CLOCAL) != 0,
                       .ignbrk_cleared = (tio.c_iflag & IGNBRK) == 0};
}

Result<void> show_settings(int master, const LineSettings& settings) {
  termios2 tio{};
  if (::ioctl(master, TCGETS2, &tio) != 0) return tty_error("reading the pty's settings");
  set_visible(tio, settings);
  if (::ioctl(master, TCSETS2, &tio) != 0) return tty_error("setting the pty");
  return {};
}

void set_ignbrk(int master) {
  termios2 tio{};
  if (::ioctl(master, TCGETS2, &tio) != 0 || (tio.c_iflag & IGNBRK) != 0) return;
  tio.c_iflag |= IGNBRK;
  (void)::ioctl(master, TCSETS2, &tio);
}

void clear_clocal(int master) {
  const int off = 0;
  (void)::ioctl(master, TIOCSSOFTCAR, &off);
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
