// How a connection ends: by the peer, by us, or half of it.

#include <cerrno>
#include <chrono>
#include <fmt/format.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/net/stream_port.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

// A peer that has half-closed: how long after the last answer it counts as gone, and how often it is looked
// at.
constexpr Nanos kQuiet = seconds(2);
constexpr Nanos kQuietWithNext = milliseconds(100);
// One that is not being read: how often it is looked at, and how long nothing of what it left may be read
// once it is gone.
constexpr Nanos kLookUnread = milliseconds(250);
constexpr Nanos kRestLimit = seconds(10);
constexpr Nanos kFirstLook = milliseconds(1);
constexpr Nanos kLook = milliseconds(20);
// How long a peer that was hung up may take to close its end.
constexpr Nanos kLeaveLimit = seconds(2);
constexpr std::size_t kMostDiscarded = std::size_t{4} << 20;

bool has_event(int fd, short events) {
  pollfd poll{fd, events, 0};
  return ::poll(&poll, 1, 0) > 0;
}

}  // namespace

std::size_t StreamPort::unread(int fd) {
  int bytes = 0;
  return ::ioctl(fd, FIONREAD, &bytes) == 0 && bytes > 0 ? static_cast<std::size_t>(bytes) : 0;
}

PeerState StreamPort::look_at_peer(int fd) {
  const PeerState state = peer_state(fd);
  if (state == PeerState::unknown && !std::exchange(told_unknown_, true)) {
    context_.log->warn(
        "{}: the kernel does not tell whether a peer has closed or only ended its sending; it is waited for "
        "(does a sandbox forbid AF_NETLINK?)",
        name());
  }
  return state;
}

void StreamPort::peer_ended() {
  const bool hung_up = line_->phase >= Phase::sending;
  line_->watch.watch_readable(false);
  // It may still read what is queued; a dead one shows when that is sent.
  if (line_->phase == Phase::sending && look_at_peer(line_->fd.get()) != PeerState::gone) return;
  if (!hung_up && !line_->end_wanted && look_at_peer(line_->fd.get()) != PeerState::gone) {
    // Before it is asked, since the last answer may come from within the question.
    line_->phase = Phase::half_closed;
    line_->since = Loop::now();
    const Line* line = line_.get();
    const PortListener::Answers answers = listener().on_ended();
    if (line_.get() != line || line_->phase != Phase::half_closed) return;
    if (answers != PortListener::Answers::none) {
      context_.log->debug("{}: the peer sends no more", name());
      line_->quiet_ends = answers == PortListener::Answers::until_it_is_quiet;
      line_timer_.set_after(kFirstLook);  // a close may still be under way on the other side
      return;
    }
  }
  finish_line({.reason = hung_up ? LineDown::Reason::hung_up : LineDown::Reason::closed,
               .error = make_error(Errc::device_lost, fmt::format("{} has closed the connection", name())),
               .after_reading = true});
}

void StreamPort::on_drained() {
  if (line_->end_wanted) (void)::shutdown(line_->fd.get(), SHUT_WR);
  if (line_->phase == Phase::sending) {
    hang_up(true);
  } else if (up_) {
    listener().on_drained();
  }
}

void StreamPort::hang_up(bool after_reading) {
  if (!line_) return;
  if (after_reading && congested()) {
    line_->phase = Phase::sending;
    return;
  }
  const bool peer_sends = line_->phase != Phase::half_closed;
  line_->phase = Phase::leaving;
  if (after_reading && peer_sends) {
    (void)::shutdown(line_->fd.get(), SHUT_WR);
    line_->watch.watch_readable(true);
    line_timer_.set_after(kLeaveLimit);
    return;
  }
  drop_line(after_reading);
  context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired()) finish_line({.reason = LineDown::Reason::hung_up, .error = {}});
  });
}

void StreamPort::on_line_timer() {
  if (!line_) return;
  if (line_->phase == Phase::half_closed) {
    watch_half_closed();
  } else if (line_->phase == Phase::leaving) {
    finish_line({.reason = LineDown::Reason::hung_up, .error = {}});
  } else if (line_->phase == Phase::up && !reading_) {
    watch_unread();
  }
}

// Without reading, no event tells that the peer is gone.
void StreamPort::watch_reading() {
  line_->watch.watch_readable(reading_);
  line_->gone_since.reset();
  if (reading_ || !passive()) {
    line_timer_.cancel();
  } else {
    line_timer_.set_after(kLookUnread);
  }
}

void StreamPort::watch_unread() {
  const int fd = line_->fd.get();
  // The end of a peer that died while it had more to send waits behind those bytes: the kernel knows.
  const bool gone = has_event(fd, 0) || look_at_peer(fd) == PeerState::gone;
  if (gone && !line_->gone_since) line_->gone_since = Loop::now();
  if (gone &&
      (unread(fd) == 0 || !listener().wants_rest() || Loop::now() - *line_->gone_since >= kRestLimit)) {
    finish_line({.reason = LineDown::Reason::closed, .error = {}});
  } else {
    line_timer_.set_after(kLookUnread);
  }
}

void StreamPort::watch_half_closed() {
  const PeerState peer = has_event(line_->fd.get(), 0) ? PeerState::gone : look_at_peer(line_->fd.get());
  const bool hurry = peer == PeerState::remote && has_event(listener_fd_.get(), POLLIN);
  const bool counts = line_->quiet_ends || hurry;
  const Nanos limit = line_->quiet_ends && hurry ? kQuietWithNext : kQuiet;
  const bool quiet = counts && !congested() && Loop::now() - line_->since >= limit;
  if (peer == PeerState::gone || quiet) {
    finish_line({.reason = LineDown::Reason::closed, .error = {}});
  } else {
    line_timer_.set_after(kLook);
  }
}

void StreamPort::line_broken(int error_number) {
  const LineDown::Reason reason = line_->phase >= Phase::sending ? LineDown::Reason::hung_up
                                  : passive()                    ? LineDown::Reason::closed
                                                                 : LineDown::Reason::lost;
  finish_line({.reason = reason,
               .error = make_error(Errc::device_lost, fmt::format("{}: the connection is lost ({})", name(),
                                                                  errno_text(error_number)))});
}

// The connection is over: tells it, and sees to the next one.
void StreamPort::finish_line(const LineDown& down) {
  drop_line(true);
  context_.log->debug("{}: disconnected", name());
  if (always_open() && down.reason != LineDown::Reason::hung_up) {
    interrupted_ = true;
    retry_later();
    listener().on_interrupted(down);
    return;
  }
  if (passive()) listener_watch_->watch_readable(opened_);
  if (std::exchange(up_, false)) listener().on_down(down);
}

// Takes what has come so far and gives how much that was.
std::uint64_t StreamPort::read_away(int fd) {
  const std::span<Byte> buffer = context_.loop->read_buffer();
  std::uint64_t bytes = 0;
  for (ssize_t size = 1; size > 0 && bytes < kMostDiscarded;) {
    size = ::recv(fd, buffer.data(), buffer.size(), 0);
    if (size > 0) bytes += static_cast<std::uint64_t>(size);
  }
  return bytes;
}

// Unread bytes would make a close a reset, which can take sent bytes from the peer: they are read first.
void StreamPort::drop_line(bool orderly) {
  line_timer_.cancel();
  if (!line_) return;
  // The rest goes on the next turn of the loop, since one of its callbacks may be running.
  const std::shared_ptr<Line> line(std::move(line_));
  line->watch.stop();
  drop(line->outbox.pending(), "they were not sent");
  if (orderly) {
    drop(read_away(line->fd.get()), "they were not read when the line was closed");
  } else {
    drop(unread(line->fd.get()), "they were not read when the line broke");
    const linger at_once{1, 0};
    (void)::setsockopt(line->fd.get(), SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
  }
  line->fd.reset();
  context_.loop->post([line] {});
}

void StreamPort::drop(std::uint64_t bytes, const char* why) {
  if (bytes > 0) listener().on_dropped(bytes, why);
}

}  // namespace porttape
