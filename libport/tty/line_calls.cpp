#include "libport/tty/line_calls.hpp"

#include <atomic>
#include <cerrno>
#include <linux/serial.h>
#include <sys/ioctl.h>

#include "libport/tty/tty.hpp"

namespace porttape {
namespace {

class SystemLineCalls final : public LineCalls {
 public:
  int set(int fd, const LineSignal& signal) override {
    if (signal.name == LineSignal::Name::brk) return done(::ioctl(fd, signal.on ? TIOCSBRK : TIOCCBRK));
    const int line = signal.name == LineSignal::Name::dtr   ? TIOCM_DTR
                     : signal.name == LineSignal::Name::rts ? TIOCM_RTS
                                                            : 0;
    return line == 0 ? EINVAL : done(::ioctl(fd, signal.on ? TIOCMBIS : TIOCMBIC, &line));
  }

  int ask(int fd, const LineRequest& request, LineAnswer& answer) override {
    answer.rs485 = request.rs485;
    switch (request.kind) {
      case LineRequest::Kind::get_serial:
        return done(::ioctl(fd, TIOCGSERIAL, &answer.serial));
      case LineRequest::Kind::set_serial:
        return done(::ioctl(fd, TIOCSSERIAL, &request.serial));
      case LineRequest::Kind::get_rs485:
        return done(::ioctl(fd, TIOCGRS485, &answer.rs485));
      case LineRequest::Kind::set_rs485:
        return done(::ioctl(fd, TIOCSRS485, &answer.rs485));
      case LineRequest::Kind::last_break:
        break;
    }
    return EINVAL;
  }

  std::size_t unsent(int fd) override {
    int left = 0;
    return ::ioctl(fd, TIOCOUTQ, &left) == 0 && left > 0 ? static_cast<std::size_t>(left) : 0;
  }

  bool wait_until_sent(int fd, Nanos patience) override {
    const std::atomic<bool> hurry = false;
    return porttape::wait_until_sent(fd, patience, hurry);
  }

  std::optional<int> modem_lines(int fd) override {
    int lines = 0;
    return ::ioctl(fd, TIOCMGET, &lines) == 0 ? std::optional(lines) : std::nullopt;
  }

  std::optional<SignalCounts> counts(int fd) override {
    serial_icounter_struct counts{};
    if (::ioctl(fd, TIOCGICOUNT, &counts) != 0) return std::nullopt;
    return SignalCounts{counts.cts, counts.dsr, counts.dcd, counts.rng, counts.brk};
  }

  int wait_for_change(int fd) override {
    return done(::ioctl(fd, TIOCMIWAIT, TIOCM_RNG | TIOCM_DSR | TIOCM_CD | TIOCM_CTS));
  }

 private:
  static int done(int result) { return result == 0 ? 0 : errno; }
};

}  // namespace

std::shared_ptr<LineCalls> LineCalls::of_system() {
  static const auto calls = std::make_shared<SystemLineCalls>();
  return calls;
}

}  // namespace porttape
