#include "libport/tty/pty_port.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <iostream>
#include <sys/ioctl.h>
#include <unistd.h>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/loop/sampler.hpp"
#include "libport/tty/tty.hpp"

namespace porttape {
namespace {

constexpr Nanos kUnreadPoll =
    std::chrono::milliseconds(2);  // no event tells that a driver has read everything

// Where that cannot be seen, it has this long to read and close.
constexpr Nanos kUnknownLimit = std::chrono::seconds(5);

// A driver that is not read: how often it is looked at, and how long what it left is kept once it has closed.
constexpr Nanos kLookUnread = std::chrono::milliseconds(250);
constexpr Nanos kRestLimit = std::chrono::seconds(10);

constexpr std::size_t kMostHeld = std::size_t{128} * 1024;

// A pty that could not be made (too many open files, say) is tried again.
constexpr Nanos kRenewAgain = std::chrono::milliseconds(500);

}  // namespace

PtyPort::Line::Line(PtyPort& port, Pty made)
    : pty(std::move(made)),
      master_watch(
          *port.context_.loop, pty.master(), [&port] { port.on_readable(); }, [this] { outbox.flush(); }),
      // A write fails only when the driver is gone; the read side sees to that.
      outbox(
          pty.master(), Outbox::Kind::file, master_watch,
          [&port] {
            if (port.up_) port.listener().on_drained();
          },
          [&port](int, std::size_t lost) { port.listener().on_dropped(lost, "they could not be sent"); }) {
  pty.on_events([&port] { port.on_event(); });
}

PtyPort::PtyPort(const PortContext& context, PtyOptions options)
    : context_(context),
      options_(std::move(options)),
      hang_up_timer_(*context.loop, [this] { on_hang_up_timer(); }),
      renew_timer_(*context.loop, [this] { renew_line(); }),
      unread_timer_(*context.loop, [this] { on_unread_timer(); }) {}

PtyPort::~PtyPort() {
  if (peer_) context_.loop->sampler().remove(this);
}

Result<void> PtyPort::prepare() {
  if (Result<void> made = make_line(); !made) return made;
  if (const std::string& path = options_.link; !path.empty()) {
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
  Result<Pty> pty = Pty::create(context_.loop->file_events(), options_.access);
  if (!pty) return pty.error();
  auto line = std::make_unique<Line>(*this, std::move(*pty));
  drop_line();
  line_ = std::move(line);
  if (const std::string trouble = context_.loop->file_events().take_trouble(); !trouble.empty())
    context_.log->warn("{}", trouble);
  return {};
}

void PtyPort::announce_path() const {
  if (link_) {
    context_.log->info("{} is there ({})", link_->path(), line_->pty.slave_path());
  } else if (context_.announces) {
    std::cout << line_->pty.slave_path() << std::endl;
  }
}

// One of the old line's callbacks may be running: it goes on the next turn of the loop.
void PtyPort::drop_line() {
  if (!line_) return;
  line_->master_watch.stop();
  line_->pty.on_events({});
  context_.loop->post([old = std::shared_ptr<Line>(std::move(line_))] {});
}

void PtyPort::replace_line() {
  drop_held();
  openers_ = 0;
  events_lost_ = false;
  peer_ = false;
  context_.loop->sampler().remove(this);
  drop_line();
  renew_line();
}

void PtyPort::renew_line() {
  if (Result<void> made = make_line(); !made) {
    context_.log->error("{}; {} is dead until that is mended", made.error().message, name());
    renew_timer_.set_after(kRenewAgain);
    return;
  }
  publish_line();
}

void PtyPort::publish_line() {
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
  } else if (line_) {
    on_event();
  }
}

// Whether a peer is there that no event told of.
void PtyPort::look() {
  if (peer_ || !line_ || (line_->pty.exact() && !events_lost_)) return;
  if (line_->pty.occupied()) return peer_arrived(std::nullopt);
  events_lost_ = false;
}

void PtyPort::close() {
  accepting_ = false;
  up_ = false;
  if (!line_) return;
  drop_unsent();
  watch_reading();
}

// Between close() and open() a peer's bytes wait for the next session.
void PtyPort::watch_reading() {
  line_->master_watch.watch_readable(may_deliver());
  gone_since_.reset();
  if (peer_ && accepting_ && !reading_) {
    unread_timer_.set_after(kLookUnread);
  } else {
    unread_timer_.cancel();
  }
}

// Without reading, its end is not seen behind the bytes that it left.
void PtyPort::on_unread_timer() {
  if (!peer_ || !line_ || !accepting_ || reading_) return;
  const Instant now = Loop::now();
  if (line_->pty.open_now()) {
    gone_since_.reset();
  } else if (!gone_since_) {
    gone_since_ = now;
  }
  const bool kept = !gone_since_ || (listener().wants_rest() && now - *gone_since_ < kRestLimit);
  if (kept) return unread_timer_.set_after(kLookUnread);
  drop_rest("the driver had closed before the device could take them");
  master_ended();
}

// What it has written and nobody has read.
void PtyPort::drop_rest(std::string_view why) {
  drop_held();
  std::uint64_t bytes = 0;
  const std::span<Byte> buffer = context_.loop->read_buffer().first(kReadSize);
  for (ssize_t size = 1; size > 0 && bytes < kMostHeld;) {
    size = ::read(line_->pty.master(), buffer.data(), buffer.size());
    if (size > 1 && buffer.front() == TIOCPKT_DATA) bytes += static_cast<std::uint64_t>(size - 1);
  }
  if (bytes > 0) listener().on_dropped(bytes, why);
}

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
  if (peer_ && line_) {
    line_->outbox.write(data);
  } else {
    listener().on_dropped(data.size(), "no driver had it open");
  }
}

std::optional<std::size_t> PtyPort::unread_by_peer() const {
  if (!peer_ || !line_) return 0;
  // Once the line is over, all of it is counted, which no driver may read any more then.
  const std::optional<std::size_t> unread = accepting_ ? line_->pty.unread() : line_->pty.read_away();
  return unread ? std::optional(line_->outbox.pending() + *unread) : std::nullopt;
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

void PtyPort::peer_arrived(Openers openers) {
  peer_ = true;
  openers_ = openers;
  context_.log->debug("{}: opened", name());
  watch_reading();
  context_.loop->sampler().add(this, [this] { set_echonl_again(line_->pty.master()); });
  set_up(true);
}

// Nobody has it open and everything is read. Events up to the last close belong to the session that ends,
// later ones to the next.
void PtyPort::master_ended() {
  const std::vector<Pty::Event> events = line_->pty.take_events();
  auto next = events.begin();
  while (next != events.end() && openers_ != 0) count(*next++);
  events_lost_ = events_lost_ || openers_ != 0;
  const Line* const line = line_.get();
  peer_left();
  if (line_.get() == line) handle_events({next, events.end()});
  // Inotify makes one event of two opens at the same moment: a driver's, and ours of settle().
  if (line_) handle_events(line_->pty.take_events());
  if (!peer_ && line_ && line_->pty.occupied()) peer_arrived(std::nullopt);
  events_lost_ = false;
}

void PtyPort::peer_left() {
  peer_ = false;
  openers_ = 0;
  hang_up_timer_.cancel();
  context_.loop->sampler().remove(this);
  context_.log->debug("{}: closed", name());
  line_->master_watch.watch_readable(false);
  drop_unsent();
  if (Result<void> settled = line_->pty.settle(); !settled) {
    if (Result<void> made = make_line(); made) {
      context_.log->info("{}; a new pty takes its place", settled.error().message);
      publish_line();
    } else {
      context_.log->warn("{}; what the last driver did not read may reach the next", settled.error().message);
    }
  }
  set_up(false);
}

// What is unread counts as the new session's. If the last one left a tail, its bytes come late, but they
// come; the other way round the new session's request would go to a device that is closed before it has
// answered.
void PtyPort::peer_reopened() {
  context_.log->debug("{}: closed and opened again", name());
  drop_unsent();
  hang_up_timer_.cancel();
  set_up(false);
  set_up(true);
}

void PtyPort::on_event() {
  if (!line_) return;
  handle_events(line_->pty.take_events());
  look();
}

// Makes sessions of what programs did since the last look.
void PtyPort::handle_events(const std::vector<Pty::Event>& events) {
  const Line* const line = line_.get();
  for (const Pty::Event event : events) {
    if (line_.get() != line) return;  // hung up from within: these were the old line's
    handle_event(event);
  }
}

void PtyPort::handle_event(Pty::Event event) {
  const bool again = openers_ == 0;
  const bool opened = event == Pty::Event::opened;
  if (opened && !peer_) openers_ = 0;
  count(event);
  if (!opened) return;
  if (!peer_) {
    peer_arrived(openers_);
  } else if (again) {
    peer_reopened();
  } else if (openers_) {
    context_.log->info("{}: a second program has opened it", name());
  }
}

void PtyPort::count(Pty::Event event) {
  switch (event) {
    case Pty::Event::opened:
      openers_ = openers_ && line_->pty.exact() ? Openers(*openers_ + 1) : std::nullopt;
      break;
    case Pty::Event::closed:
      if (openers_ && *openers_ > 0) --*openers_;
      break;
    case Pty::Event::unknown:
      if (peer_) openers_.reset();
      events_lost_ = true;
      break;
    case Pty::Event::changed:
      break;
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
  const std::span<Byte> buffer = context_.loop->read_buffer().first(kReadSize);
  const ssize_t size = ::read(line_->pty.master(), buffer.data(), buffer.size());
  if (size > 0) {
    take_packet(ByteView(buffer).first(static_cast<std::size_t>(size)));
    return static_cast<std::size_t>(size) == buffer.size();
  }
  if (size < 0 && (errno == EAGAIN || errno == EINTR)) return false;
  master_ended();
  return false;
}

// A reopen may have come before these bytes without having woken us yet. A session that has just begun is not
// read before its device is up: then they are kept.
void PtyPort::take_packet(ByteView packet) {
  const std::vector<Pty::Event> events = line_->pty.take_events();
  if (events.empty()) return handle_packet(packet);
  held_.assign(packet.begin(), packet.end());
  handle_events(events);
  deliver_held();
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
  const bool in = (status & TIOCPKT_FLUSHREAD) != 0;
  const bool out = (status & TIOCPKT_FLUSHWRITE) != 0;
  if (in) {
    const bool was_congested = congested();
    line_->outbox.discard();
    if (was_congested && up_) listener().on_drained();
  }
  if (in || out) listener().on_flush(in && out ? FlushQueue::both : in ? FlushQueue::in : FlushQueue::out);
}

void PtyPort::read_pending() {
  if (!peer_ && accepting_) on_event();  // one that has come and gone before anything told of it
  deliver_held();
  // What a pty can hold, so that a driver that goes on writing does not keep us.
  for (std::size_t left = kMostHeld; left > 0 && line_ && may_deliver();) {
    const std::span<Byte> buffer = context_.loop->read_buffer().first(kReadSize);
    const ssize_t size = ::read(line_->pty.master(), buffer.data(), buffer.size());
    if (size <= 0) break;
    left -= std::min(left, static_cast<std::size_t>(size));
    take_packet(ByteView(buffer).first(static_cast<std::size_t>(size)));
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
    drop_rest("the line was hung up before they could be passed on");
    replace_line();
    context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {
      if (!alive.expired()) set_up(false, LineDown::Reason::hung_up);
    });
    return;
  }
  unknown_since_.reset();
  hang_up_timer_.set_after(kUnreadPoll);
}

void PtyPort::on_hang_up_timer() {
  if (!peer_) return;
  const std::optional<std::size_t> unread = congested() ? 1 : line_->pty.unread();
  if (!unread) tell_waiting();
  if (unread == 0 || (!unread && Loop::now() - *unknown_since_ >= kUnknownLimit)) {
    hang_up(false);
  } else {
    hang_up_timer_.set_after(kUnreadPoll);
  }
}

void PtyPort::tell_waiting() {
  if (unknown_since_) return;
  unknown_since_ = Loop::now();
  context_.log->warn(
      "{}: whether the driver has read everything cannot be seen (it keeps the line to itself, TIOCEXCL, and "
      "this "
      "process is not root; or no descriptor is left); it has {} s to close",
      name(), std::chrono::duration_cast<std::chrono::seconds>(kUnknownLimit).count());
}

std::string PtyPort::name() const {
  const std::string path = place().path;
  return path.empty() ? "pty" : "pty:" + path;
}

PortPlace PtyPort::place() const {
  if (link_) return {.path = link_->path()};
  return {.path = line_ ? line_->pty.slave_path() : std::string()};
}

std::string PtyPort::peer_node() const { return line_ ? line_->pty.slave_path() : std::string(); }

}  // namespace porttape
