#include "libport/net/stream_port.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <fmt/format.h>
#include <linux/sockios.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <utility>

#include <spdlog/spdlog.h>

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr Nanos kConnectLimit = seconds(10);
constexpr Nanos kFirstRetry = milliseconds(100);
constexpr Nanos kLongestRetry = seconds(5);
constexpr Nanos kAcceptRetry = milliseconds(100);

Nanos connect_limit(const CommonOptions& common) {
  return common.timeout && *common.timeout > Nanos{0} ? *common.timeout : kConnectLimit;
}

}  // namespace

StreamPort::Line::Line(StreamPort& port, UniqueFd connected)
    : fd(std::move(connected)),
      watch(
          *port.context_.loop, fd.get(), [&port] { port.on_readable(); }, [this] { outbox.flush(); }),
      outbox(
          fd.get(), Outbox::Kind::socket, watch, [&port] { port.on_drained(); },
          [&port, this](int error_number, std::size_t lost) {
            port.drop(lost, "they could not be sent");
            // From within a write of the caller's, who must not see the line vanish under it.
            port.context_.loop->post([&port, this, error_number, alive = std::weak_ptr<int>(port.alive_)] {
              if (!alive.expired() && port.line_.get() == this) port.line_broken(error_number);
            });
          }) {}

StreamPort::StreamPort(const PortContext& context, const CommonOptions& common, StreamOptions options)
    : context_(context),
      common_(common),
      stream_(options),
      retry_timer_(*context.loop,
                   [this] {
                     if (passive()) {
                       listener_watch_->watch_readable(opened_ && !line_);
                     } else {
                       connect();
                     }
                   }),
      line_timer_(*context.loop, [this] { on_line_timer(); }),
      retry_delay_(kFirstRetry) {}

StreamPort::~StreamPort() = default;

Result<void> StreamPort::prepare() {
  if (!passive()) {
    if (Result<void> there = check_peer(); !there && !keeps_trying()) return there;
    if (always_open()) connect();
    return {};
  }
  Result<UniqueFd> listener = make_listener();
  if (!listener) return listener.error();
  listener_fd_ = std::move(*listener);
  listener_watch_.emplace(*context_.loop, listener_fd_.get(), [this] { on_acceptable(); });
  return {};
}

void StreamPort::open() {
  opened_ = true;
  if (passive()) {
    listener_watch_->watch_readable(!line_);
  } else if (line_) {
    up_ = true;
    listener().on_up();
  } else if (!connector_ && !retry_timer_.due()) {
    connect();
  }
}

void StreamPort::close() {
  opened_ = up_ = false;
  if (passive()) listener_watch_->watch_readable(false);
  if (!always_open()) {
    connector_.reset();
    retry_timer_.cancel();
    retry_delay_ = kFirstRetry;
    drop_line(true);
  } else if (line_) {
    drop(line_->outbox.pending(), "they were not sent");
    line_->outbox.discard();
  }
}

void StreamPort::connect() {
  connector_ = std::make_unique<Connector>(*context_.loop, connect_limit(common_),
                                           [this](Result<UniqueFd> result) { connected(std::move(result)); });
  connect_to_peer(*connector_);
}

void StreamPort::retry_later() {
  retry_timer_.set_after(retry_delay_);
  retry_delay_ = std::min(retry_delay_ * 2, kLongestRetry);
}

void StreamPort::connected(Result<UniqueFd> result) {
  connector_.reset();
  if (!result && keeps_trying()) {
    context_.log->log(retry_delay_ == kFirstRetry ? spdlog::level::warn : spdlog::level::debug,
                      "{}; trying again", result.error().message);
    retry_later();
    return;
  }
  if (!result) {
    if (opened_) listener().on_down({.reason = LineDown::Reason::failed, .error = result.error()});
    return;
  }
  retry_delay_ = kFirstRetry;
  begin_line(std::move(*result));
  if (std::exchange(interrupted_, false)) listener().on_resumed();
  if (!opened_ || up_) return;
  up_ = true;
  listener().on_up();
}

void StreamPort::on_acceptable() {
  UniqueFd fd(::accept4(listener_fd_.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
  if (!fd) {
    if (errno == EAGAIN || errno == EINTR || errno == ECONNABORTED) return;
    context_.log->error("{}: a connection cannot be accepted: {}", name(), errno_text(errno));
    listener_watch_->watch_readable(false);
    retry_timer_.set_after(kAcceptRetry);
    return;
  }
  listener_watch_->watch_readable(false);
  begin_line(std::move(fd));
  up_ = true;
  listener().on_up();
}

void StreamPort::begin_line(UniqueFd fd) {
  set_up(fd.get());
  context_.log->debug("{}: connected", name());
  line_ = std::make_unique<Line>(*this, std::move(fd));
  watch_reading();
}

void StreamPort::write(ByteView data) {
  if (!line_ || line_->phase >= Phase::sending || line_->end_wanted) {
    drop(data.size(), "the line is not up");
    return;
  }
  if (!common_.writes) {
    drop(data.size(), "the port is for reading only");
    return;
  }
  if (line_->phase == Phase::half_closed) line_->since = Loop::now();
  line_->outbox.write(data);
}

std::size_t StreamPort::write_some(ByteView data) {
  if (!common_.writes) return data.size();
  if (!line_ || line_->phase >= Phase::sending || line_->end_wanted) return 0;
  if (line_->phase == Phase::half_closed) line_->since = Loop::now();
  return line_->outbox.write_some(data);
}

std::optional<std::size_t> StreamPort::unread_by_peer() const {
  if (!line_) return 0;
  int queued = 0;
  const bool known = ::ioctl(line_->fd.get(), SIOCOUTQ, &queued) == 0 && queued > 0;
  return line_->outbox.pending() + (known ? static_cast<std::size_t>(queued) : 0);
}

// What has come so far; what the kernel has taken is on its way.
bool StreamPort::discard() {
  if (!line_) return true;
  line_->outbox.discard();
  (void)read_away(line_->fd.get());
  return true;
}

bool StreamPort::end_writing() {
  if (!line_ || always_open()) return false;  // the next session writes on this connection
  if (std::exchange(line_->end_wanted, true)) return true;
  if (!congested()) (void)::shutdown(line_->fd.get(), SHUT_WR);
  return true;
}

void StreamPort::set_reading(bool on) {
  if (reading_ == on) return;
  reading_ = on;
  if (line_ && line_->phase == Phase::up) watch_reading();
}

// One read a turn of the loop, so that a fast peer keeps nobody else waiting.
void StreamPort::on_readable() {
  const std::span<Byte> buffer = context_.loop->read_buffer();
  const ssize_t size = ::recv(line_->fd.get(), buffer.data(), buffer.size(), 0);
  if (size < 0) {
    if (errno != EAGAIN && errno != EINTR) line_broken(errno);
  } else if (size == 0) {
    peer_ended();
  } else {
    received(ByteView(buffer).first(static_cast<std::size_t>(size)));
  }
}

void StreamPort::received(ByteView data) {
  if (line_->phase != Phase::up) {
    drop(data.size(), "they came after the line was hung up");
  } else if (!common_.reads) {
    drop(data.size(), "the port is for writing only");
  } else {
    listener().on_data(data);
  }
}

void StreamPort::read_pending() {
  std::size_t left = line_ ? unread(line_->fd.get()) : 0;
  while (line_ && line_->phase == Phase::up && reading_ && left > 0) {
    const std::span<Byte> buffer = context_.loop->read_buffer();
    const ssize_t size = ::recv(line_->fd.get(), buffer.data(), std::min(left, buffer.size()), 0);
    if (size <= 0) return;
    left -= static_cast<std::size_t>(size);
    received(ByteView(buffer).first(static_cast<std::size_t>(size)));
  }
}

}  // namespace porttape
