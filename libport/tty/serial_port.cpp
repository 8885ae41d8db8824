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
#include "libport/tty/device_identity.hpp"

namespace porttape {
namespace {

Error missing(std::string message) { return make_error(Errc::device_missing, std::move(message)); }

constexpr std::size_t kMostUnread = std::size_t{64} * 1024;

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

// As long as the kernel waits at a close for a device that takes nothing (closing_wait).
constexpr Nanos kClosingWait = std::chrono::seconds(30);
// A watch that the device keeps from ending any longer has it open for itself.
constexpr Nanos kWatchEnds = std::chrono::seconds(5);

// A line that is to be closed.
struct LineToLeave {
  UniqueFd fd;
  std::vector<LineSettings> to_make;      // in turn
  bool breaks = false;                    // a break may be on
  std::shared_future<void> watched = {};  // until then a watch has a descriptor of it
  bool waits = true;                // until the device has sent what was written; never on the loop's thread
  std::atomic<bool> hurry = false;  // somebody waits for it
  std::size_t lost = 0;             // bytes that the device did not take
};

// Makes the settings and closes it, with the modem lines as the close leaves them before the last settings
// are made. What a device does not take it would take against its flow control then, and is dropped.
void leave(LineToLeave& line) {
  const int fd = line.fd.get();
  if (line.breaks) (void)::ioctl(fd, TIOCCBRK);
  for (const LineSettings& settings : line.to_make) {
    int left = 0;
    if (line.waits && !wait_until_sent(fd, kClosingWait, line.hurry) && ::ioctl(fd, TIOCOUTQ, &left) == 0 &&
        left > 0) {
      (void)::tcflush(fd, TCOFLUSH);
      line.lost += static_cast<std::size_t>(left);
    }
    if (&settings == &line.to_make.back()) lower_modem_lines(fd);
    (void)apply_settings(fd, settings);
  }
  if (!line.to_make.empty()) lower_modem_lines(fd);
  // The next open() is to find it free.
  if (line.watched.valid()) {
    if (line.waits) (void)line.watched.wait_for(kWatchEnds);
    (void)::flock(fd, LOCK_UN);
  }
  line.fd.reset();
}

// A tty that another program holds open would keep it, against this one too.
void give_up_exclusive_use(int fd) { (void)::ioctl(fd, TIOCNXCL); }

int access_mode(const CommonOptions& common) {
  return !common.writes ? O_RDONLY : !common.reads ? O_WRONLY : O_RDWR;
}

}  // namespace

SerialPort::Line::Line(SerialPort& port, UniqueFd opened)
    : fd(std::move(opened)),
      watch(
          *port.context_.loop, fd.get(), [&port] { port.on_readable(); }, [this] { outbox.flush(); },
          [&port] { port.lost(EIO); }),
      outbox(
          fd.get(), Outbox::Kind::file, watch, [this] { changes.outbox_drained(); },
          [&port](int error_number, std::size_t lost) {
            port.listener().told(line::Dropped{lost, "they could not be sent"});
            // From within a write of the caller's, who must not see the line vanish under it.
            port.context_.loop->post([&port, error_number, alive = std::weak_ptr<int>(port.alive_)] {
              if (!alive.expired()) port.lost(error_number);
            });
          }),
      changes(
          *port.context_.loop, {fd.get(), outbox, port.strand_, port.calls_}, port.current_,
          {[&port](const LineSettings& wanted, const Result<TakenSettings>& taken) {
             port.change_made(wanted, taken);
           },
           [&port](const LineSignal& signal, int error_number) { port.signal_made(signal, error_number); },
           [&port] {
             if (port.up_) port.listener().on_drained();
           }}) {}

SerialPort::SerialPort(const PortContext& context, const CommonOptions& common, SerialOptions options,
                       std::shared_ptr<LineCalls> calls)
    : context_(context),
      common_(common),
      options_(std::move(options)),
      calls_(std::move(calls)),
      current_(options_.settings) {}

SerialPort::~SerialPort() {
  if (!line_) return;
  line_->watch.stop();
  try {
    close_elsewhere(*line_, {});
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
  identity_ = identity_of(options_.device);
  Result<void> free = check_free();
  if (!free && options_.wait) {
    context_.log->warn("{}; waiting for it", free.error().message);
    return {};
  }
  if (!free || !common_.always_open) return free;
  Result<UniqueFd> fd = open_device();
  if (!fd) return fd.error();
  begin_line(std::move(*fd));
  return {};
}

std::optional<PortIdentity> SerialPort::identity() const {
  return identity_ ? identity_ : identity_of(options_.device);
}

void SerialPort::begin_line(UniqueFd fd) {
  line_ = std::make_unique<Line>(*this, std::move(fd));
  line_began_ = context_.loop->now();
  watch_reading();
  // As the settings were made: before anything can come of it.
  if (signals_wanted_) line_->lines = calls_->modem_lines(line_->fd.get());
  if (line_->lines) watch_modem();
  context_.log->debug("{}: open", name());
}

void SerialPort::open() {
  opened_ = true;
  if (line_) return come_up();  // always open
  if (interrupted_) return;
  open_waits_ = closing_ > 0;
  if (open_waits_) {
    *hurry_ = true;
  } else {
    try_open();
  }
}

void SerialPort::try_open() {
  if (line_) return;  // two wake-ups in one turn of the loop
  Result<UniqueFd> fd = open_device();
  if (!fd) {
    if (!options_.wait && !interrupted_) {
      listener().on_down({.reason = LineDown::Reason::failed, .error = fd.error()});
    } else if (!waiting_) {
      if (!interrupted_) context_.log->warn("{}; waiting for it", fd.error().message);
      wait_for_device(PathWatch::kFirst);
    }
    return;
  }
  // The watch may be what called us.
  if (waiting_) context_.loop->post([old = std::shared_ptr<PathWatch>(std::move(waiting_))] {});
  begin_line(std::move(*fd));
  if (std::exchange(interrupted_, false)) {
    drive_again();
    listener().on_resumed();
    if (opened_ && up_) tell_signals();
  }
  if (opened_ && !up_ && line_) come_up();
  if (std::exchange(untold_, false)) listener().told(line::Settings{SeenSettings::of(current_)});
}

Result<void> SerialPort::check_free() const {
  const auto holder = uucp_holder(options_.lock_folder, options_.device);
  if (!holder) return {};
  return missing(fmt::format("device {} is busy: {}", in_quotes(options_.device), to_text(*holder)));
}

// One that cannot be made costs no line.
Result<void> SerialPort::lock() {
  if (!options_.uucp_lock || lock_) return {};
  Result<UucpLock> lock = UucpLock::take(options_.lock_folder, options_.device);
  if (lock) {
    lock_.emplace(std::move(*lock));
  } else if (lock.error().code == Errc::device_missing) {
    return missing(fmt::format("device {} is busy: {}", in_quotes(options_.device), lock.error().message));
  } else {
    warn_once(fmt::format("{}: option 'uucplock': {}", name(), lock.error().message));
  }
  return {};
}

void SerialPort::warn_once(const std::string& text) {
  if (told_.insert(text).second) context_.log->warn("{}", text);
}

// Looks at locks before it touches the device: that raises DTR.
Result<UniqueFd> SerialPort::open_device() {
  if (Result<void> free = check_free(); !free) return free.error();
  UniqueFd fd(::open(options_.device.c_str(), access_mode(common_) | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  if (!fd)
    return missing(
        fmt::format("device {}: {}; {}", in_quotes(options_.device), errno_text(errno), advice_for(errno)));
  if (::isatty(fd.get()) == 0)
    return missing(fmt::format("device {} is not a serial device", in_quotes(options_.device)));
  if (::flock(fd.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    return missing(fmt::format("device {} is busy; {}", in_quotes(options_.device), advice_for(EBUSY)));
  }
  if (Result<void> locked = lock(); !locked) return locked.error();
  (void)::ioctl(fd.get(), TIOCEXCL);
  if (Result<void> set = set_line(fd.get()); !set) {
    lock_.reset();
    give_up_exclusive_use(fd.get());
    return in_device(set.error());
  }
  return fd;
}

// A device that does not take what was given without it still does what it did before.
void SerialPort::try_settings(int fd) {
  const std::optional<LineSettings> wanted = std::exchange(untried_, std::nullopt);
  if (!wanted) return;
  if (const Result<TakenSettings> set = apply_settings(fd, *wanted); set) {
    current_ = set->settings;
  } else {
    context_.log->warn("{}: {}; it keeps its settings", name(), set.error().message);
    untold_ = true;
  }
}

Result<void> SerialPort::set_line(int fd) {
  try_settings(fd);
  const Result<TakenSettings> taken = apply_settings(fd, current_);
  if (!taken) return taken.error();
  current_ = taken->settings;
  tell_not_taken(taken->not_taken);
  set_modem(fd, "dtr", TIOCM_DTR, options_.dtr);
  set_modem(fd, "rts", TIOCM_RTS, options_.rts);
  (void)::tcflush(fd, TCIFLUSH);
  return {};
}

void SerialPort::set_modem(int fd, const char* option, int line, std::optional<bool> on) {
  if (!on) return;
  if (Result<void> set = set_modem_line(fd, line, *on); !set)
    warn_once(fmt::format("{}: option '{}': {}", name(), option, set.error().message));
}

void SerialPort::come_up() {
  up_ = true;
  listener().on_up();
  if (up_) tell_signals();
}

void SerialPort::close() {
  opened_ = up_ = open_waits_ = false;
  told_refused_ = false;
  if (!interrupted_) waiting_.reset();
  untried_.reset();
  if (!line_ || !common_.always_open) driven_.clear();
  made_.clear();
  if (!line_) {
    current_ = options_.settings;
    return;
  }
  discard_unsent();
  if (!common_.always_open) {
    drop_line(settings_to_leave());
    current_ = options_.settings;
    return;
  }
  line_->changes.end_drains();
  release_driven();
  if (*settings() != options_.settings) line_->changes.change(options_.settings);
}

// What a line that is closed still has to get: changes under way, and the user's own settings again.
std::vector<LineSettings> SerialPort::settings_to_leave() const {
  std::vector<LineSettings> left = line_->changes.left();
  if (line_->changes.settings() != options_.settings) left.push_back(options_.settings);
  return left;
}

void SerialPort::discard_unsent() {
  if (const std::size_t bytes = line_->changes.pending(); bytes > 0)
    listener().told(line::Dropped{bytes, "they were not sent"});
  line_->changes.discard();
}

void SerialPort::drop_line(std::vector<LineSettings> to_make) {
  discard_unsent();
  current_ = line_->changes.settings();
  line_->changes.stop();
  // The rest goes on the next turn of the loop, since one of its callbacks may be running.
  line_->watch.stop();
  close_elsewhere(*line_, std::move(to_make));
  if (closing_ == 0) lock_.reset();
  context_.loop->post([old = std::shared_ptr<Line>(std::move(line_))] {});
}

// The device is left as the user has it, behind what was written. Its modem lines fall before its rate
// changes, since there are devices that reset when they fall at 1200 baud.
void SerialPort::close_elsewhere(Line& left, std::vector<LineSettings> to_make) {
  UniqueFd fd = std::move(left.fd);
  const std::unique_ptr<ModemWatch> modem = std::move(left.modem);
  give_up_exclusive_use(fd.get());
  if (context_.pulled) return;  // its program waits in its calls, and has closed it when they return
  // Unplugged: nothing can be sent, and while it is held the device gets another name when it comes back.
  pollfd state{fd.get(), 0, 0};
  if (::poll(&state, 1, 0) > 0 && (state.revents & POLLHUP) != 0) return;
  const auto line = std::make_shared<LineToLeave>();
  line->fd = std::move(fd);
  line->to_make = std::move(to_make);
  line->breaks = left.changes.breaks();
  if (modem) line->watched = modem->left();
  hurry_ = {line, &line->hurry};
  ++closing_;
  const bool taken = context_.loop->run_elsewhere(
      strand_, [line] { leave(*line); },
      [this, line, alive = std::weak_ptr<int>(alive_)] {
        if (!alive.expired()) closed(line->lost);
      });
  if (taken) return;
  --closing_;
  const std::size_t unsent = calls_->unsent(line->fd.get());
  (void)::tcflush(line->fd.get(), TCOFLUSH);
  line->waits = false;
  leave(*line);
  if (unsent > 0) {
    listener().told(line::Dropped{unsent, "no thread was to be had to wait until the device has sent them"});
  }
}

void SerialPort::closed(std::size_t lost) {
  if (lost > 0) listener().told(line::Dropped{lost, "the device did not take them before it was closed"});
  if (--closing_ > 0) return;
  if (!line_) lock_.reset();
  if (std::exchange(open_waits_, false)) try_open();
}

void SerialPort::write(ByteView data) {
  if (line_ && !!common_.writes) {
    line_->changes.write(data);
  } else {
    listener().told(
        line::Dropped{data.size(), line_ ? "the device is open for reading only" : "the line is not up"});
  }
}

std::size_t SerialPort::write_some(ByteView data) {
  if (!line_) return 0;
  return !common_.writes ? data.size() : line_->changes.write_some(data);
}

std::optional<std::size_t> SerialPort::unread_by_peer() const {
  if (!line_) return 0;
  return line_->changes.pending() + calls_->unsent(line_->fd.get());
}

bool SerialPort::discard() {
  if (!line_) return true;
  line_->changes.discard();
  (void)::tcflush(line_->fd.get(), TCIOFLUSH);
  return true;
}

Result<void> SerialPort::apply(const LineSettings& settings) {
  if (!options_.follow || settings == *this->settings()) return {};
  if (!line_) {
    untried_ = settings;
    return {};
  }
  if (!context_.pulled) {
    line_->changes.change(settings);
    return {};
  }
  // Its program waits: nothing else would be done meanwhile.
  const Result<TakenSettings> taken = line_->changes.change_at_once(settings);
  if (!taken) return in_device(taken.error());
  current_ = taken->settings;
  tell_not_taken(taken->not_taken);
  return {};
}

void SerialPort::change_made(const LineSettings& wanted, const Result<TakenSettings>& taken) {
  if (taken) {
    current_ = taken->settings;
    tell_not_taken(taken->not_taken);
  } else if (!std::exchange(told_refused_, true)) {
    context_.log->warn("{}; the device keeps its settings (told once)", in_device(taken.error()).message);
  }
  if (current_ != wanted && line_->changes.settings() == current_)
    listener().told(line::Settings{SeenSettings::of(current_)});
}

void SerialPort::tell_not_taken(const std::string& what) {
  if (!what.empty()) warn_once(fmt::format("{}: the device did not take: {}", name(), what));
}

Error SerialPort::in_device(const Error& error) const {
  return make_error(error.code, fmt::format("device {}: {}", in_quotes(options_.device), error.message));
}

void SerialPort::set_reading(bool on) {
  reading_ = on;
  if (line_) watch_reading();
}

// One that is gone is closed at once, whether it is read or not (the kernel has dropped what was unread). A
// program that waits in its calls learns of it by its next one.
void SerialPort::watch_reading() {
  const bool reads = reading_ && common_.reads;
  line_->watch.watch_readable(reads);
  line_->watch.watch_hang_up(!reads && !context_.pulled);
}

void SerialPort::on_readable() {
  while (line_ && reading_ && read_once()) {
  }
}

bool SerialPort::read_once() {
  const std::span<Byte> buffer = context_.loop->read_buffer();
  const ssize_t size = ::read(line_->fd.get(), buffer.data(), buffer.size());
  if (size > 0) {
    const ByteView data = ByteView(buffer).first(static_cast<std::size_t>(size));
    look_for_break(data);
    listener().on_data(data);
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
  std::size_t left = known ? static_cast<std::size_t>(std::max(there, 0)) : kMostUnread;
  while (line_ && reading_ && left > 0) {
    const std::span<Byte> buffer = context_.loop->read_buffer();
    const ssize_t size = ::read(line_->fd.get(), buffer.data(), buffer.size());
    if (size <= 0) return;
    left -= std::min(left, static_cast<std::size_t>(size));
    const ByteView data = ByteView(buffer).first(static_cast<std::size_t>(size));
    look_for_break(data);
    listener().on_data(data);
  }
}

void SerialPort::lost(int error_number) {
  if (!line_) return;
  drop_line({});
  const Error error =
      make_error(Errc::device_lost, fmt::format("device {} is lost ({}); plug it in again",
                                                in_quotes(options_.device), errno_text(error_number)));
  const LineDown down{.reason = LineDown::Reason::lost, .error = error};
  if (common_.always_open) {
    interrupted_ = true;
    listener().on_interrupted(down);
    if (context_.loop->now() - line_began_ >= kLineHeld) reopen_wait_.reset();
    if (!waiting_) wait_for_device(reopen_wait_.next());
  } else if (std::exchange(up_, false)) {
    listener().on_down(down);
  }
}

void SerialPort::wait_for_device(Nanos first) {
  waiting_ = std::make_unique<PathWatch>(
      *context_.loop, options_.device, [this] { try_open(); }, first);
}

void SerialPort::hang_up(bool) {
  if (line_) drop_line(settings_to_leave());
  if (!std::exchange(up_, false)) return;
  context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired()) listener().on_down({.reason = LineDown::Reason::hung_up, .error = {}});
  });
}

}  // namespace porttape
