#include "libport/net/stream_line.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <fmt/format.h>
#include <linux/sockios.h>
#include <poll.h>
#include <span>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <utility>

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

// A peer that has half-closed: how long after the last answer it counts as gone, and how often it is looked
// at.
constexpr Nanos kQuiet = seconds(2);
constexpr Nanos kQuietWithNext = milliseconds(100);
constexpr Nanos kFirstLook = milliseconds(1);
constexpr Nanos kLook = milliseconds(20);
// One that is not being read: how often it is looked at, and how long the session's other line may take
// nothing once this one is gone.
constexpr Nanos kLookUnread = milliseconds(250);
constexpr Nanos kRestLimit = seconds(10);
// How long a peer that was hung up may take to close its end.
constexpr Nanos kLeaveLimit = seconds(2);
// What an ended peer has left is no more than its socket's buffer.
constexpr int kMostReads = 256;
constexpr std::size_t kMostDiscarded = std::size_t{4} << 20;

// Whether one of these events is there, or the line is broken or ended both ways.
bool has_event(int fd, short events) {
  pollfd poll{fd, events, 0};
  return ::poll(&poll, 1, 0) > 0;
}

bool hung_up(int fd) { return has_event(fd, 0); }

}  // namespace

bool has_ended(int fd) { return has_event(fd, POLLRDHUP); }

StreamLine::StreamLine(Loop& loop, Owner& owner, Side side, std::string name, UniqueFd fd)
    : loop_(&loop),
      owner_(&owner),
      side_(side),
      name_(std::move(name)),
      fd_(std::move(fd)),
      watch_(
          loop, fd_.get(), [this] { on_readable(); }, [this] { outbox_.flush(); }),
      outbox_(
          fd_.get(), Outbox::Kind::socket, watch_, [this] { on_drained(); },
          [this](int error_number, std::size_t lost) {
            owner_->dropped(lost, "they could not be sent");
            // From within a write of the caller's, who must not see the line vanish under it.
            loop_->post([this, error_number, alive = std::weak_ptr<int>(alive_)] {
              if (!alive.expired() && phase_ != Phase::over) broken(error_number);
            });
          }),
      timer_(loop, [this] { on_timer(); }) {}

void StreamLine::write(ByteView data) {
  if (phase_ == Phase::half_closed) since_ = loop_->now();
  outbox_.write(data);
}

std::size_t StreamLine::write_some(ByteView data) {
  if (phase_ == Phase::half_closed) since_ = loop_->now();
  return outbox_.write_some(data);
}

bool StreamLine::tell(const LineEvent& event) {
  const auto* const drain = std::get_if<line::Drain>(&event);
  if (drain == nullptr || !congested()) return false;
  outbox_.put([this, sent = line::Sent{drain->number}](Outbox::Turn) {  // what is dropped is not waited for
    owner_->line_told(sent);
    return true;
  });
  return true;
}

std::size_t StreamLine::unsent() const {
  int queued = 0;
  const bool known = ::ioctl(fd_.get(), SIOCOUTQ, &queued) == 0;
  return outbox_.pending() + (known ? static_cast<std::size_t>(queued) : 0);
}

std::size_t StreamLine::drop_unsent() {
  const std::size_t bytes = outbox_.pending();
  outbox_.discard();
  return bytes;
}

void StreamLine::end_writing() {
  if (std::exchange(end_wanted_, true)) return;
  if (!congested()) (void)::shutdown(fd_.get(), SHUT_WR);
}

void StreamLine::on_drained() {
  if (end_wanted_) (void)::shutdown(fd_.get(), SHUT_WR);
  if (end_wanted_ && phase_ == Phase::half_closed) {  // that was the last of both directions
    loop_->post([this, alive = std::weak_ptr<int>(alive_)] {
      if (!alive.expired() && phase_ == Phase::half_closed) tell_closed();
    });
  }
  owner_->line_drained();
}

void StreamLine::set_reading(bool on) {
  reading_ = on;
  if (phase_ == Phase::up) watch_reading();
}

// Without reading, no event tells that the peer is gone.
void StreamLine::watch_reading() {
  watch_.watch_readable(reading_);
  rest_wait_.reset();
  if (reading_ || side_ == Side::connected) {
    timer_.cancel();
  } else {
    timer_.set_after(kLookUnread);
  }
}

// One read a turn of the loop, so that a fast peer keeps nobody else waiting.
void StreamLine::on_readable() {
  const std::span<Byte> buffer = loop_->read_buffer();
  const ssize_t size = ::recv(fd_.get(), buffer.data(), buffer.size(), 0);
  if (size < 0) {
    if (errno != EAGAIN && errno != EINTR) broken(errno);
  } else if (size == 0) {
    peer_ended();
  } else {
    received(ByteView(buffer).first(static_cast<std::size_t>(size)));
  }
}

void StreamLine::received(ByteView data) {
  if (phase_ != Phase::up) {
    owner_->dropped(data.size(), "they came after the line was hung up");
  } else {
    owner_->line_data(data);
  }
}

void StreamLine::read_pending() {
  std::size_t left = unread();
  while (phase_ == Phase::up && reading_) {  // where nothing is left, none is asked for and none comes
    const std::span<Byte> buffer = loop_->read_buffer();
    const ssize_t size = ::recv(fd_.get(), buffer.data(), std::min(left, buffer.size()), 0);
    if (size <= 0) return;
    left -= static_cast<std::size_t>(size);
    received(ByteView(buffer).first(static_cast<std::size_t>(size)));
  }
}

bool StreamLine::has_peer() const { return phase_ == Phase::up && !has_ended(fd_.get()); }

bool StreamLine::left_bytes() const { return phase_ == Phase::up && has_ended(fd_.get()) && unread() > 0; }

void StreamLine::catch_up() {
  if (!has_ended(fd_.get())) return;
  for (int reads = 0; reads < kMostReads && phase_ == Phase::up && reading_; ++reads) on_readable();
}

std::size_t StreamLine::unread() const {
  int bytes = 0;
  return ::ioctl(fd_.get(), FIONREAD, &bytes) == 0 ? static_cast<std::size_t>(bytes) : 0;
}

std::uint64_t StreamLine::read_away() {
  const std::span<Byte> buffer = loop_->read_buffer();
  std::uint64_t bytes = 0;
  while (bytes < kMostDiscarded) {
    const ssize_t size = ::recv(fd_.get(), buffer.data(), buffer.size(), 0);
    if (size <= 0) break;
    bytes += static_cast<std::uint64_t>(size);
  }
  return bytes;
}

void StreamLine::peer_ended() {
  watch_.watch_readable(false);
  // It may still read what is queued; a dead one shows when that is sent.
  if (phase_ == Phase::sending && owner_->look_at_peer(fd_.get()) != PeerState::gone) return;
  const bool sent_all = end_wanted_ && !congested();
  if (phase_ == Phase::up && !sent_all && owner_->look_at_peer(fd_.get()) != PeerState::gone) {
    // Before it is asked, since the last answer may come from within the question.
    phase_ = Phase::half_closed;
    since_ = loop_->now();
    const PortListener::Answers answers = owner_->line_ended();
    if (phase_ != Phase::half_closed) return;
    if (answers != PortListener::Answers::none) {
      quiet_ends_ = answers == PortListener::Answers::until_it_is_quiet;
      timer_.set_after(kFirstLook);  // a close may still be under way on the other side
      return;
    }
  }
  tell_closed();
}

void StreamLine::tell_closed() {
  const bool hung_up = phase_ >= Phase::sending;
  owner_->line_over(
      {.reason = hung_up ? LineDown::Reason::hung_up : LineDown::Reason::closed,
       .error = make_error(Errc::device_lost, fmt::format("{} has closed the connection", name_)),
       .after_reading = true});
}

void StreamLine::broken(int error_number) {
  const LineDown::Reason reason = phase_ >= Phase::sending  ? LineDown::Reason::hung_up
                                  : side_ == Side::accepted ? LineDown::Reason::closed
                                                            : LineDown::Reason::lost;
  owner_->line_over({.reason = reason,
                     .error = make_error(Errc::device_lost, fmt::format("{}: the connection is lost ({})",
                                                                        name_, errno_text(error_number)))});
}

void StreamLine::on_timer() {
  switch (phase_) {
    case Phase::half_closed:
      return watch_half_closed();
    case Phase::leaving:
      return owner_->line_over({.reason = LineDown::Reason::hung_up, .error = {}});
    case Phase::up:
      if (!reading_) watch_unread();
      return;
    case Phase::sending:
    case Phase::over:
      return;
  }
}

void StreamLine::watch_unread() {
  // The end of a peer that died while it had more to send waits behind those bytes: the kernel knows.
  const bool gone = hung_up(fd_.get()) || owner_->look_at_peer(fd_.get()) == PeerState::gone;
  if (gone && !rest_wait_) rest_wait_.emplace(loop_->now(), kRestLimit);
  if (gone && (unread() == 0 || !owner_->wants_rest() ||
               !rest_wait_->goes_on(loop_->now(), owner_->unread_elsewhere()))) {
    owner_->line_over({.reason = LineDown::Reason::closed, .error = {}});
  } else {
    timer_.set_after(kLookUnread);
  }
}

void StreamLine::watch_half_closed() {
  const PeerState peer = hung_up(fd_.get()) ? PeerState::gone : owner_->look_at_peer(fd_.get());
  const bool hurry = peer == PeerState::remote && owner_->next_waits();
  const bool counts = quiet_ends_ || hurry;
  const Nanos limit = quiet_ends_ && hurry ? kQuietWithNext : kQuiet;
  const bool quiet = counts && !congested() && loop_->now() - since_ >= limit;
  if (peer == PeerState::gone || quiet) {
    owner_->line_over({.reason = LineDown::Reason::closed, .error = {}});
  } else {
    timer_.set_after(kLook);
  }
}

bool StreamLine::hang_up(bool after_reading) {
  if (after_reading && congested()) {
    phase_ = Phase::sending;
    return true;
  }
  const bool peer_sends = phase_ != Phase::half_closed;
  phase_ = Phase::leaving;
  if (!after_reading || !peer_sends) return false;
  (void)::shutdown(fd_.get(), SHUT_WR);
  watch_.watch_readable(true);
  timer_.set_after(kLeaveLimit);
  return true;
}

// Unread bytes would make a close a reset, which can take sent bytes from the peer: they are read first.
void StreamLine::close(bool orderly) {
  phase_ = Phase::over;
  timer_.cancel();
  owner_->dropped(drop_unsent(), "they were not sent");
  watch_.stop();
  if (orderly) {
    owner_->dropped(read_away(), "they were not read when the line was closed");
  } else {
    owner_->dropped(unread(), "they were not read when the line broke");
    const linger at_once{1, 0};
    (void)::setsockopt(fd_.get(), SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
  }
  fd_.reset();
}

}  // namespace porttape
