#include "tests/bench/line.hpp"

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <ctime>
#include <fcntl.h>
#include <sys/time.h>
#include <termios.h>
#include <unistd.h>
#include <utility>

#include "libport/base/error.hpp"

namespace porttape::bench {
namespace {

volatile std::sig_atomic_t caught_signal = 0;
volatile std::sig_atomic_t watchdog_bit = 0;
std::string watchdog_text;  // one Watchdog at a time

void on_signal(int number) {
  if (number == SIGALRM) {
    watchdog_bit = 1;
  } else {
    caught_signal = number;
  }
}

void make_raw(int fd, const std::string& path) {
  termios settings{};
  if (::tcgetattr(fd, &settings) != 0) {
    if (errno == ENOTTY || errno == EINVAL) return;
    throw_errno(path);
  }
  ::cfmakeraw(&settings);
  settings.c_cc[VMIN] = 1;
  settings.c_cc[VTIME] = 0;
  if (::tcsetattr(fd, TCSANOW, &settings) != 0) throw_errno(path);
}

}  // namespace

void throw_errno(const std::string& what) {
  const int error_number = errno;
  throw BenchError(what + ": " + errno_text(error_number));
}

void install_signal_handlers() {
  struct sigaction action {};
  action.sa_handler = on_signal;  // no SA_RESTART: blocking calls must end
  for (const int number : {SIGINT, SIGTERM, SIGALRM}) ::sigaction(number, &action, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
}

void check_signals() {
  if (caught_signal != 0) throw Interrupted(caught_signal);
  if (watchdog_bit != 0) throw BenchError("timed out: " + watchdog_text);
}

Watchdog::Watchdog(unsigned seconds, std::string what) {
  watchdog_text = std::move(what);
  watchdog_bit = 0;
  // Repeated, since the first signal may come just before the blocking call.
  const itimerval timer{{0, 200'000}, {static_cast<time_t>(seconds), 0}};
  ::setitimer(ITIMER_REAL, &timer, nullptr);
}

Watchdog::~Watchdog() {
  const itimerval off{};
  ::setitimer(ITIMER_REAL, &off, nullptr);
  watchdog_bit = 0;
}

std::int64_t now_ns() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

void sleep_ms(int ms) {
  const timespec pause{ms / 1000, (ms % 1000) * 1'000'000L};
  ::nanosleep(&pause, nullptr);
  check_signals();
}

Pty make_pty() {
  Pty pty;
  pty.master.reset(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC));
  if (!pty.master) throw_errno("no new pty");
  if (::grantpt(pty.master.get()) != 0 || ::unlockpt(pty.master.get()) != 0) throw_errno("pty");
  char name[128];
  if (::ptsname_r(pty.master.get(), name, sizeof name) != 0) throw_errno("pty");
  pty.slave = name;
  make_raw(pty.master.get(), pty.slave);
  return pty;
}

UniqueFd open_port(const std::string& path) {
  UniqueFd fd(::open(path.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC));
  if (!fd) throw_errno(path);
  make_raw(fd.get(), path);
  return fd;
}

std::size_t read_some(int fd, Byte* data, std::size_t size) {
  for (;;) {
    const ssize_t n = ::read(fd, data, size);
    if (n >= 0) return static_cast<std::size_t>(n);
    if (errno == EIO) return 0;
    if (errno != EINTR) throw_errno("read");
    check_signals();
  }
}

void read_exact(int fd, Byte* data, std::size_t size) {
  while (size > 0) {
    const std::size_t n = read_some(fd, data, size);
    if (n == 0) throw BenchError("the line hung up");
    data += n;
    size -= n;
  }
}

void write_all(int fd, const Byte* data, std::size_t size) {
  while (size > 0) {
    const ssize_t n = ::write(fd, data, size);
    if (n < 0) {
      if (errno != EINTR) throw_errno("write");
      check_signals();
      continue;
    }
    data += n;
    size -= static_cast<std::size_t>(n);
  }
}

}  // namespace porttape::bench
