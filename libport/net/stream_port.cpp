#include "libport/net/stream_port.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

#include <spdlog/spdlog.h>

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr Nanos kConnectLimit = seconds(10);
constexpr Nanos kFirstRetry = milliseconds(100);
constexpr Nanos kLongestRetry = seconds(5);

Nanos connect_limit(const CommonOptions& common) {
  return common.timeout && *common.timeout > Nanos{0} ? *common.timeout : kConnectLimit;
}

}  // namespace

StreamPort::StreamPort(const PortContext& context, const CommonOptions& common, StreamOptions options)
    : StreamPort(context, common, options, UniqueFd()) {}

StreamPort::StreamPort(const PortContext& context, const CommonOptions& common, StreamOptions options,
                       UniqueFd given)
    : context_(context),
      common_(common),
      stream_(options),
      given_(std::move(given)),
      was_given_(static_cast<bool>(given_)),
      retry_timer_(*context.loop, [this] { connect(); }),
      retry_wait_(kFirstRetry, kLongestRetry) {}

StreamPort::~StreamPort() {
  if (given_) reset_connection(std::move(given_));  // nobody wanted it
}

CommonOptions StreamPort::common_of_connections() const {
  CommonOptions common = common_;
  common.always_open = false;
  return common;
}

Result<void> StreamPort::prepare() {
  if (was_given_) return {};
  if (!passive()) {
    if (Result<void> there = check_peer(); !there && !keeps_trying()) return there;
    if (always_open()) connect();
    return {};
  }
  Result<UniqueFd> listener = make_listener();
  if (!listener) return listener.error();
  StreamListener::Owner& owner = *this;
  door_.emplace(context_, owner, name(), std::move(*listener));
  return {};
}

void StreamPort::open() {
  opened_ = true;
  if (passive()) {
    door_->accept(true);
  } else if (was_given_) {
    if (given_) come_up(std::move(given_));
  } else if (line_) {
    up_ = true;
    listener().on_up();
  } else if (!connector_ && !retry_timer_.due()) {
    connect();
  }
}

void StreamPort::close() {
  opened_ = up_ = false;
  if (door_) door_->accept(false);
  if (!always_open()) {
    connector_.reset();
    retry_timer_.cancel();
    retry_wait_.reset();
    drop_line(true);
  } else if (line_) {
    dropped(line_->drop_unsent(), "they were not sent");
  }
}

void StreamPort::connect() {
  connector_ = std::make_unique<Connector>(*context_.loop, connect_limit(common_),
                                           [this](Result<UniqueFd> result) { connected(std::move(result)); });
  connect_to_peer(*connector_);
}

void StreamPort::retry_later() { retry_timer_.set_after(retry_wait_.next()); }

void StreamPort::connected(Result<UniqueFd> result) {
  connector_.reset();
  if (!result && keeps_trying()) {
    context_.log->log(retry_wait_.is_first() ? spdlog::level::warn : spdlog::level::debug, "{}; trying again",
                      result.error().message);
    retry_later();
    return;
  }
  if (!result) {
    if (opened_) listener().on_down({.reason = LineDown::Reason::failed, .error = result.error()});
    return;
  }
  begin_line(std::move(*result));
  if (std::exchange(interrupted_, false)) listener().on_resumed();
  if (!opened_ || up_) return;
  up_ = true;
  listener().on_up();
}

StreamListener::Inside StreamPort::inside() {
  if (line_) line_->catch_up();
  // A line that was hung up is over once that has been told.
  if (!line_) return up_ ? StreamListener::Inside::ended : StreamListener::Inside::nobody;
  return line_->has_peer() ? StreamListener::Inside::there : StreamListener::Inside::ended;
}

void StreamPort::let_in(UniqueFd fd, const std::string& who) {
  context_.log->debug("{}: {} has connected", name(), who);
  if (take_) return take_(port_of(std::move(fd)), who);
  come_up(std::move(fd));
}

void StreamPort::come_up(UniqueFd fd) {
  begin_line(std::move(fd));
  up_ = true;
  listener().on_up();
}

void StreamPort::begin_line(UniqueFd fd) {
  set_up(fd.get());
  if (!passive()) context_.log->debug("{}: connected", name());
  const auto side = is_called() ? StreamLine::Side::accepted : StreamLine::Side::connected;
  StreamLine::Owner& owner = *this;
  line_ = std::make_unique<StreamLine>(*context_.loop, owner, side, name(), std::move(fd));
  line_->set_reading(reading_);
  line_began_ = context_.loop->now();
}

void StreamPort::write(ByteView data) {
  if (!line_ || !line_->takes()) {
    dropped(data.size(), "the line is not up");
  } else if (!common_.writes) {
    dropped(data.size(), "the port is for reading only");
  } else {
    line_->write(data);
  }
}

std::size_t StreamPort::write_some(ByteView data) {
  if (!common_.writes) return data.size();
  return line_ && line_->takes() ? line_->write_some(data) : 0;
}

std::optional<std::size_t> StreamPort::unread_by_peer() const { return line_ ? line_->unsent() : 0; }

bool StreamPort::discard() {
  if (!line_) return true;
  (void)line_->drop_unsent();
  (void)line_->read_away();
  return true;
}

bool StreamPort::end_writing() {
  if (!line_ || !has_half_close()) return false;
  line_->end_writing();
  return true;
}

void StreamPort::set_reading(bool on) {
  if (reading_ == on) return;
  reading_ = on;
  if (line_) line_->set_reading(on);
}

void StreamPort::read_pending() {
  if (line_) line_->read_pending();
}

void StreamPort::line_data(ByteView data) {
  retry_wait_.reset();
  if (common_.reads) {
    listener().on_data(data);
  } else {
    dropped(data.size(), "the port is for writing only");
  }
}

void StreamPort::tell(const LineEvent& event) {
  if (!line_ || !line_->tell(event)) Port::tell(event);
}

// An answer comes from the loop, since the caller may be in the midst of closing the line.
void StreamPort::line_told(const LineEvent& event) {
  if (keeps_place(event)) return listener().told(event);
  context_.loop->post([this, event, alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired()) listener().told(event);
  });
}

void StreamPort::line_drained() {
  if (line_->hangs_up_when_sent()) {
    hang_up(true);
  } else if (up_) {
    listener().on_drained();
  }
}

PortListener::Answers StreamPort::line_ended() {
  if (!has_half_close()) return PortListener::Answers::none;
  const PortListener::Answers answers = listener().on_ended();
  if (answers != PortListener::Answers::none) context_.log->debug("{}: the peer sends no more", name());
  return answers;
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

void StreamPort::hang_up(bool after_reading) {
  if (!line_ || line_->hang_up(after_reading)) return;
  drop_line(after_reading);
  context_.loop->post([this, alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired()) line_over({.reason = LineDown::Reason::hung_up, .error = {}});
  });
}

// Tells it, and sees to the next line.
void StreamPort::line_over(const LineDown& down) {
  drop_line(true);
  context_.log->debug("{}: disconnected", name());
  if (always_open() && down.reason != LineDown::Reason::hung_up) {
    interrupted_ = true;
    if (context_.loop->now() - line_began_ >= kLineHeld) retry_wait_.reset();
    retry_later();
    listener().on_interrupted(down);
    return;
  }
  if (door_) door_->left();
  if (std::exchange(up_, false)) listener().on_down(down);
}

void StreamPort::drop_line(bool orderly) {
  if (!line_) return;
  // The rest goes on the next turn of the loop, since one of its callbacks may be running.
  const std::shared_ptr<StreamLine> line(std::move(line_));
  line->close(orderly);
  context_.loop->post([line] {});
}

void StreamPort::dropped(std::uint64_t bytes, const char* why) {
  if (bytes > 0) listener().told(line::Dropped{bytes, why});
}

}  // namespace porttape
