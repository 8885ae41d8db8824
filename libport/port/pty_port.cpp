#include "libport/port/pty_port.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cstdio>
#include <iostream>
#include <sys/ioctl.h>
#include <unistd.h>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/port/tty.hpp"

namespace porttape {
namespace {

constexpr Nanos kUnreadPoll =
    std::chrono::milliseconds(2);  // no event tells that a driver has read everything

// How often the driver's settings are looked at: drivers set them mostly just after opening.
constexpr Nanos kFirstLooks = std::chrono::milliseconds(10);
constexpr Nanos kLaterLooks = std::chrono::milliseconds(100);
constexpr Nanos kSettlingTime = std::chrono::seconds(1);

constexpr std::size_t kMostHeld = std::size_t{128} * 1024;

// A pty that could not be made (too many open files, say) is tried again.
constexpr Nanos kRenewAgain = std::chrono::milliseconds(500);

Result<Pty::Access> access_of(const PortOptions& options) {
  Pty::Access access{0, options.text("owner"), options.text("group")};
  const std::string mode = options.text("mode");
  const auto [end, error] = std::from_chars(mode.data(), mode.data() + mode.size(), access.mode, 8);
  if (error != std::errc{} || end != mode.data() + mode.size() || access.mode > 0777) {
    return make_error(Errc::usage,
                      "option 'mode': '" + mode + "' is not valid; accepted: octal permissions like 0660");
  }
  return access;
}

}  // namespace

PtyPort::Line::Line(PtyPort& port, Pty made)
    : pty(std::move(made)),
      master_watch(
          *port.context_.loop, pty.master(), [&port] { port.on_readable(); }, [this] { outbox.flush(); }),
      wake_watch(*port.context_.loop, pty.wake_fd(), [&port] { port.on_wake(); }),
      // A write fails only when the driver is gone, which the read side notices.
      outbox(
          pty.master(), Outbox::Kind::file, master_watch,
          [&port] {
            if (port.up_) port.listener().on_drained();
          },
          [](int, std::size_t) {}) {
  wake_watch.watch_readable(true);
}

PtyPort::PtyPort(const PortContext& context, const PortOptions& options)
    : context_(context),
      options_(options),
      hang_up_timer_(*context.loop, [this] { on_hang_up_timer(); }),
      look_timer_(*context.loop, [this] { on_look_timer(); }),
      renew_timer_(*context.loop, [this] { renew_line(); }) {}

PtyPort::~PtyPort() = default;

Result<void> PtyPort::prepare() {
  if (Result<void> made = make_line(); !made) return made;
  const std::string path = options_.text("link");
  if (!path.empty()) {
    Result<PtyLink> link = PtyLink::publish(path, line_->pty.slave_path());
    if (!link) {
      line_.reset();
      return link.error();
    }
    link_ = std::move(*link);
  }
  announce_path();
  return {};
}

Result<void> PtyPort::make_line() {
  Result<Pty::Access> access = access_of(options_);
  if (!access) return access.error();
  Result<Pty> pty = Pty::create(*access);
  if (!pty) return pty.error();
  line_ = std::make_unique<Line>(*this, std::move(*pty));
  return {};
}

void PtyPort::announce_path() const {
  if (link_) {
    context_.log->info("{} is there ({})", link_->path(), line_->pty.slave_path());
  } else {
    std::cout << line_->pty.slave_path() << std::endl;
  }
}

void PtyPort::replace_line() {
  drop_held();
  openers_ = 0;
  peer_ = false;
  // One of the old line's callbacks may be running: it goes on the next turn of the loop.
  context_.loop->post([old = std::shared_ptr<Line>(std::move(line_))] {});
  renew_line();
}

void PtyPort::renew_line() {
  if (Result<void> made = make_line(); !made) {
    context_.log->error("{}; {} is dead until that is mended", made.error().message, name());
    renew_timer_.set_after(kRenewAgain);
    return;
  }
  if (link_) {
    if (Result<void> moved = link_->retarget(line_->pty.slave_path()); !moved)
      context_.log->error("{}", moved.error().message);
  }
  if (!link_) announce_path();
}

void PtyPort::open() {
  accepting_ = true;
  if (peer_) {
    watch_reading();
    deliver_held_soon();
    set_up(true);
  } else {
    look();
  }
}

void PtyPort::look() {
  if (peer_ || !line_ || !line_->pty.occupied()) return;
  (void)line_->pty.take_events();  // the open that we see is among them
  peer_arrived();
}

void PtyPort::close() {
  accepting_ = false;
  up_ = false;
  if (!line_) return;
  drop_unsent();
  watch_reading();
}

// Between close() and open() a peer's bytes wait for the next session.
void PtyPort::watch_reading() { line_->master_watch.watch_readable(peer_ && accepting_ && reading_); }

void PtyPort::drop_unsent() {
  const std::size_t bytes = line_->outbox.pending();
  line_->outbox.discard();
  if (bytes > 0) listener().on_dropped(bytes, "the driver did not take them");
}

void PtyPort::drop_held() {
  if (held_.size() > 1 && held_.front() == TIOCPKT_DATA)
    listener().on_dropped(held_.size() - 1, "the line ended before they could be passed on");
  held_.clear();
}

void PtyPort::write(ByteView data) {
  if (peer_ && line_) line_->outbox.write(data);
}

std::optional<std::size_t> PtyPort::unread_by_peer() const {
  return peer_ && line_ ? line_->outbox.pending() + line_->pty.unread() : 0;
}

void PtyPort::set_reading(bool on) {
  reading_ = on;
  if (!line_) return;
  watch_reading();
  deliver_held_soon();
}

void PtyPort::set_up(bool up, LineDown::Reason reason) {
  if (up_ == up || (up && !accepting_)) return;
  up_ = up;
  if (up) {
    listener().on_up();
  } else {
    listener().on_down({.reason = reason, .error = {}});
  }
}

void PtyPort::peer_arrived() {
  peer_ = true;
  openers_ = 1;
  context_.log->debug("{}: opened", name());
  watch_reading();
  arrived_ = Loop::now();
  look_timer_.set_after(kFirstLooks);
  set_up(true);
}

void PtyPort::peer_left() {
  peer_ = false;
  openers_ = 0;
  hang_up_timer_.cancel();
  look_timer_.cancel();
  context_.log->debug("{}: closed", name());
  line_->master_watch.watch_readable(false);
  drop_unsent();
  if (Result<void> settled = line_->pty.settle(); !settled) {
    context_.log->debug("{}; a new pty takes its place", settled.error().message);
    replace_line();
  }
  set_up(false);
  look();  // opened again meanwhile
}

// What is unread counts as the new session's. If the last one left a tail, its bytes come late, but they
// come; the other way round the new session's request would go to a device that is closed before it has
// answered.
void PtyPort::peer_reopened() {
  context_.log->debug("{}: closed and opened again", name());
  drop_unsent();
  openers_ = 1;
  set_up(false);
  set_up(true);
}

void PtyPort::on_wake() {
  if (!line_) return;
  take_events();
  look();
}

// Makes sessions of what programs did since the last look.
void PtyPort::take_events() {
  const Line* const line = line_.get();
  for (const Pty::Event event : line_->pty.take_events()) {
    if (line_.get() != line) return;  // hung up from within: these were the old line's
    if (event == Pty::Event::closed) {
      if (openers_ > 0) --openers_;
    } else if (!peer_) {
      peer_arrived();
    } else if (openers_ == 0) {
      peer_reopened();
    } else {
      ++openers_;
      context_.log->info("{}: a second program has opened it", name());
    }
  }
}

void PtyPort::on_readable() {
  if (!line_) return;
  // More than one read only when the first was full: an extra read for EAGAIN would cost each short exchange.
  deliver_held();
  while (may_deliver() && read_once()) {
  }
}

bool PtyPort::read_once() {
  const ssize_t size = ::read(line_->pty.master(), buffer_.data(), buffer_.size());
  if (size > 0) {
    // A reopen may have come before these bytes without having woken us yet.
    const Line* const line = line_.get();
    take_events();
    if (line_.get() != line) return false;
    take_packet(ByteView(buffer_).first(static_cast<std::size_t>(size)));
    return static_cast<std::size_t>(size) == buffer_.size();
  }
  if (size < 0 && (errno == EAGAIN || errno == EINTR)) return false;
  peer_left();
  return false;
}

// A session that has just begun is not read before its device is up.
void PtyPort::take_packet(ByteView packet) {
  if (may_deliver() && held_.empty()) {
    handle_packet(packet);
  } else {
    held_.assign(packet.begin(), packet.end());
  }
}

void PtyPort::deliver_held() {
  if (!held_.empty() && may_deliver()) handle_packet(std::exchange(held_, {}));
}

// Not from within the call that allows it.
void PtyPort::deliver_held_soon() {
  if (held_.empty() || !may_deliver()) return;
  context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired()) deliver_held();
  });
}

void PtyPort::handle_packet(ByteView packet) {
  const Byte status = packet.front();
  if (status == TIOCPKT_DATA) {
    if (packet.size() > 1) listener().on_data(packet.subspan(1));
    return;
  }
  if ((status & TIOCPKT_FLUSHREAD) != 0) {
    context_.log->trace("{}: the driver flushed its input", name());
    const bool was_congested = congested();
    line_->outbox.discard();
    if (was_congested && up_) listener().on_drained();
  }
}

void PtyPort::read_pending() {
  deliver_held();
  // What a pty can hold, so that a driver that goes on writing does not keep us.
  for (std::size_t left = kMostHeld; left > 0 && line_ && may_deliver();) {
    const ssize_t size = ::read(line_->pty.master(), buffer_.data(), buffer_.size());
    if (size <= 0) break;
    left -= std::min(left, static_cast<std::size_t>(size));
    handle_packet(ByteView(buffer_).first(static_cast<std::size_t>(size)));
  }
}

void PtyPort::finish() {
  drop_held();
  listener().on_complete(0);
}

void PtyPort::hang_up(bool after_reading) {
  if (!peer_) return;
  if (!after_reading) {
    context_.log->debug("{}: hung up", name());
    replace_line();
    context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {
      if (!alive.expired()) set_up(false, LineDown::Reason::hung_up);
    });
    return;
  }
  hang_up_timer_.set_after(kUnreadPoll);
}

void PtyPort::on_hang_up_timer() {
  if (!peer_) return;
  if (congested() || line_->pty.unread() > 0) {
    hang_up_timer_.set_after(kUnreadPoll);
  } else {
    hang_up(false);
  }
}

void PtyPort::on_look_timer() {
  if (!peer_ || !line_) return;
  renew_mark(line_->pty.master());
  look_timer_.set_after(Loop::now() - arrived_ < kSettlingTime ? kFirstLooks : kLaterLooks);
}

std::string PtyPort::name() const {
  if (link_) return "pty:" + link_->path();
  return line_ ? "pty:" + line_->pty.slave_path() : "pty";
}

}  // namespace porttape
