#include "libport/tty/serial_port.hpp"

#include <algorithm>
#include <cerrno>
#include <exception>
#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <span>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/base/printable.hpp"
#include "libport/tty/device_access.hpp"

namespace porttape {
namespace {

Error missing(std::string message) { return make_error(Errc::device_missing, std::move(message)); }

constexpr std::size_t kMostHeld = std::size_t{64} * 1024;

std::string advice_for(int error_number) {
  switch (error_number) {
    case ENOENT:
      return "is it plugged in? (--wait-device waits for it)";
    case EACCES:
      return "ls -l tells who may open it";
    case EBUSY:
      return "another program has it open";
    default:
      return "check the device";
  }
}

int access_mode(const CommonOptions& common) {
  return !common.writes ? O_RDONLY : !common.reads ? O_WRONLY : O_RDWR;
}

}  // namespace

SerialPort::Line::Line(SerialPort& port, UniqueFd opened)
    : fd(std::move(opened)),
      watch(
          *port.context_.loop, fd.get(), [&port] { port.on_readable(); }, [this] { outbox.flush(); }),
      outbox(
          fd.get(), Outbox::Kind::file, watch,
          [&port] {
            if (port.up_) port.listener().on_drained();
          },
          [&port](int error_number, std::size_t lost) {
            port.listener().on_dropped(lost, "they could not be sent");
            // From within a write of the caller's, who must not see the line vanish under it.
            port.context_.loop->post([&port, error_number, alive = std::weak_ptr<int>(port.alive_)] {
              if (!alive.expired()) port.lost(error_number);
            });
          }) {}

SerialPort::SerialPort(const PortContext& context, const CommonOptions& common, SerialOptions options)
    : context_(context), common_(common), options_(std::move(options)) {}

SerialPort::~SerialPort() {
  if (!line_) return;
  line_->watch.stop();
  try {
    close_elsewhere(std::move(line_->fd));
  } catch (const std::exception&) {  // no memory: it is closed here
  }
}

Result<void> SerialPort::prepare() {
  struct stat status {};
  if (::stat(options_.device.c_str(), &status) != 0) {
    const int error = errno;
    if (options_.wait) {
      context_.log->warn("device {}: {}; waiting for it", in_quotes(options_.device), errno_text(error));
      return {};
    }
    return missing(
        fmt::format("device {}: {}; {}", in_quotes(options_.device), errno_text(error), advice_for(error)));
  }
  // Where it cannot be known, opening it tells.
  if (!S_ISCHR(status.st_mode) || is_tty_device(status.st_rdev) == false) {
    return missing(fmt::format("device {} is {}, not a serial device", in_quotes(options_.device),
                               S_ISDIR(status.st_mode)   ? "a folder"
                               : S_ISREG(status.st_mode) ? "a file"
                                                         : "something else"));
  }
  const int wanted = access_mode(common_) == O_RDONLY   ? R_OK
                     : access_mode(common_) == O_WRONLY ? W_OK
                                                        : R_OK | W_OK;
  if (::access(options_.device.c_str(), wanted) != 0) {
    const int error = errno;
    const std::string advice =
        error == EACCES ? access_advice(device_access(options_.device, wanted)) : advice_for(error);
    return missing(fmt::format("device {}: {}; {}", in_quotes(options_.device), errno_text(error), advice));
  }
  if (!common_.always_open) return {};
  Result<UniqueFd> fd = open_device();
  if (!fd) return fd.error();
  begin_line(std::move(*fd));
  return {};
}

void SerialPort::begin_line(UniqueFd fd) {
  line_ = std::make_unique<Line>(*this, std::move(fd));
  watch_reading();
  context_.log->debug("{}: open", name());
}

void SerialPort::open() {
  opened_ = true;
  if (line_) {  // always open
    up_ = true;
    listener().on_up();
    return;
  }
  if (interrupted_) return;
  open_waits_ = closing_ > 0;
  if (!open_waits_) try_open();
}

void SerialPort::try_open() {
  if (line_) return;  // two wake-ups in one turn of the loop
  Result<UniqueFd> fd = open_device();
  if (!fd) {
    if (!options_.wait && !interrupted_) {
      listener().on_down({.reason = LineDown::Reason::failed, .error = fd.error()});
    } else if (!waiting_) {
      if (!interrupted_) context_.log->warn("{}; waiting for it", fd.error().message);
      waiting_ = std::make_unique<PathWatch>(*context_.loop, options_.device, [this] { try_open(); });
    }
    return;
  }
  // The watch may be what called us.
  if (waiting_) context_.loop->post([old = std::shared_ptr<PathWatch>(std::move(waiting_))] {});
  begin_line(std::move(*fd));
  if (std::exchange(interrupted_, false)) {
    context_.log->info("device {} is there again", in_quotes(options_.device));
    listener().on_resumed();
  }
  if (!opened_ || up_) return;
  up_ = true;
  listener().on_up();
}

Result<UniqueFd> SerialPort::open_device() {
  UniqueFd fd(::open(options_.device.c_str(), access_mode(common_) | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  if (!fd)
    return missing(
        fmt::format("device {}: {}; {}", in_quotes(options_.device), errno_text(errno), advice_for(errno)));
  if (::isatty(fd.get()) == 0)
    return missing(fmt::format("device {} is not a serial device", in_quotes(options_.device)));
  if (::flock(fd.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    return missing(fmt::format("device {} is busy; {}", in_quotes(options_.device), advice_for(EBUSY)));
  }
  (void)::ioctl(fd.get(), TIOCEXCL);
  if (Result<void> set = set_line(fd.get()); !set) {
    return make_error(set.error().code,
                      fmt::format("device {}: {}", in_quotes(options_.device), set.error().message));
  }
  return fd;
}

// A device that does not take what was given without it still does what it did before.
void SerialPort::try_settings(int fd) {
  const std::optional<LineSettings> wanted = std::exchange(untried_, std::nullopt);
  if (!wanted) return;
  if (const Result<std::string> set = apply_settings(fd, *wanted); set) {
    options_.settings = *wanted;
  } else {
    context_.log->warn("{}: {}; it keeps its settings", name(), set.error().message);
  }
}

Result<void> SerialPort::set_line(int fd) {
  try_settings(fd);
  const Result<std::string> not_taken = apply_settings(fd, options_.settings);
  if (!not_taken) return not_taken.error();
  if (!not_taken->empty()) context_.log->warn("{}: the device did not take: {}", name(), *not_taken);
  set_modem(fd, "dtr", TIOCM_DTR, options_.dtr);
  set_modem(fd, "rts", TIOCM_RTS, options_.rts);
  (void)::tcflush(fd, TCIFLUSH);
  return {};
}

void SerialPort::set_modem(int fd, const char* option, int line, std::optional<bool> on) const {
  if (!on) return;
  if (Result<void> set = set_modem_line(fd, line, *on); !set)
    context_.log->warn("{}: option '{}': {}", name(), option, set.error().message);
}

void SerialPort::close() {
  opened_ = up_ = open_waits_ = false;
  if (!interrupted_) waiting_.reset();
  if (!line_) return;
  discard_unsent();
  if (!common_.always_open) drop_line();
}

void SerialPort::discard_unsent() {
  if (const std::size_t bytes = line_->outbox.pending(); bytes > 0)
    listener().on_dropped(bytes, "they were not sent");
  line_->outbox.discard();
}

void SerialPort::drop_line() {
  discard_unsent();
  // A tty that another program holds open would keep it, against this one too.
  (void)::ioctl(line_->fd.get(), TIOCNXCL);
  // The rest goes on the next turn of the loop, since one of its callbacks may be running.
  line_->watch.stop();
  close_elsewhere(std::move(line_->fd));
  context_.loop->post([old = std::shared_ptr<Line>(std::move(line_))] {});
}

void SerialPort::close_elsewhere(UniqueFd fd) {
  if (context_.pulled) return;  // its program waits in its calls, and has closed it when they return
  // Unplugged: nothing can be sent, and while it is held the device gets another name when it comes back.
  pollfd state{fd.get(), 0, 0};
  if (::poll(&state, 1, 0) > 0 && (state.revents & POLLHUP) != 0) return;
  const auto held = std::make_shared<UniqueFd>(std::move(fd));
  ++closing_;
  const bool taken = context_.loop->run_elsewhere(
      closing_strand_, [held] { held->reset(); },
      [this, alive = std::weak_ptr<int>(alive_)] {
        if (!alive.expired()) closed();
      });
  if (taken) return;
  --closing_;
  int unsent = 0;
  if (::ioctl(held->get(), TIOCOUTQ, &unsent) != 0) unsent = 0;
  (void)::tcflush(held->get(), TCOFLUSH);
  if (unsent > 0) {
    listener().on_dropped(static_cast<std::uint64_t>(unsent),
                          "no thread was to be had to wait until the device has sent them");
  }
}

void SerialPort::closed() {
  if (--closing_ == 0 && std::exchange(open_waits_, false)) try_open();
}

void SerialPort::write(ByteView data) {
  if (line_ && !!common_.writes) {
    line_->outbox.write(data);
  } else {
    listener().on_dropped(data.size(), line_ ? "the device is open for reading only" : "the line is not up");
  }
}

std::size_t SerialPort::write_some(ByteView data) {
  if (!line_) return 0;
  return !common_.writes ? data.size() : line_->outbox.write_some(data);
}

std::optional<std::size_t> SerialPort::unread_by_peer() const {
  if (!line_) return 0;
  int queued = 0;
  const bool known = ::ioctl(line_->fd.get(), TIOCOUTQ, &queued) == 0 && queued > 0;
  return line_->outbox.pending() + (known ? static_cast<std::size_t>(queued) : 0);
}

bool SerialPort::discard() {
  if (!line_) return true;
  line_->outbox.discard();
  (void)::tcflush(line_->fd.get(), TCIOFLUSH);
  return true;
}

Result<void> SerialPort::apply(const LineSettings& settings) {
  if (!line_) {
    untried_ = settings;
    return {};
  }
  Result<std::string> set = apply_settings(line_->fd.get(), settings);
  if (!set) {
    const Error error = make_error(
        set.error().code, fmt::format("device {}: {}", in_quotes(options_.device), set.error().message));
    (void)apply_settings(line_->fd.get(), options_.settings);
    return error;
  }
  if (!set->empty()) context_.log->warn("{}: the device did not take: {}", name(), *set);
  options_.settings = settings;
  return {};
}

void SerialPort::set_reading(bool on) {
  reading_ = on;
  if (line_) watch_reading();
}

void SerialPort::watch_reading() { line_->watch.watch_readable(reading_ && common_.reads); }

void SerialPort::on_readable() {
  while (line_ && reading_ && read_once()) {
  }
}

bool SerialPort::read_once() {
  const std::span<Byte> buffer = context_.loop->read_buffer();
  const ssize_t size = ::read(line_->fd.get(), buffer.data(), buffer.size());
  if (size > 0) {
    listener().on_data(ByteView(buffer).first(static_cast<std::size_t>(size)));
    return static_cast<std::size_t>(size) >= 4095;  // what a tty gives at most: there may be more
  }
  if (size < 0 && (errno == EAGAIN || errno == EINTR)) return false;
  lost(size == 0 ? EIO : errno);
  return false;
}

void SerialPort::read_pending() {
  int there = 0;
  // Where it cannot be seen how much there is, what a tty holds at most.
  const bool known = line_ && ::ioctl(line_->fd.get(), FIONREAD, &there) == 0;
  std::size_t left = known ? static_cast<std::size_t>(std::max(there, 0)) : kMostHeld;
  while (line_ && reading_ && left > 0) {
    const std::span<Byte> buffer = context_.loop->read_buffer();
    const ssize_t size = ::read(line_->fd.get(), buffer.data(), buffer.size());
    if (size <= 0) return;
    left -= std::min(left, static_cast<std::size_t>(size));
    listener().on_data(ByteView(buffer).first(static_cast<std::size_t>(size)));
  }
}

void SerialPort::lost(int error_number) {
  if (!line_) return;
  drop_line();
  const Error error =
      make_error(Errc::device_lost, fmt::format("device {} is lost ({}); plug it in again",
                                                in_quotes(options_.device), errno_text(error_number)));
  const LineDown down{.reason = LineDown::Reason::lost, .error = error};
  if (common_.always_open) {
    interrupted_ = true;
    listener().on_interrupted(down);
    if (!waiting_)
      waiting_ = std::make_unique<PathWatch>(*context_.loop, options_.device, [this] { try_open(); });
  } else if (std::exchange(up_, false)) {
    listener().on_down(down);
  }
}

void SerialPort::hang_up(bool) {
  if (line_) drop_line();
  if (!std::exchange(up_, false)) return;
  context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired()) listener().on_down({.reason = LineDown::Reason::hung_up, .error = {}});
  });
}

}  // namespace porttape
