#include "daemon/supervised_channel.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <exception>
#include <fmt/format.h>
#include <sys/eventfd.h>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/base/unique_fd.hpp"

namespace porttape {
namespace {

using std::chrono::seconds;

constexpr Nanos kFirstDelay = seconds(1);
constexpr Nanos kLongestDelay = seconds(30);

// A line without a descriptor left for its device's connection would be up for nothing.
Result<void> descriptor_left() {
  const UniqueFd probe(::eventfd(0, EFD_CLOEXEC));
  if (probe) return {};
  return make_error(
      Errc::io,
      fmt::format("no descriptor is left for a connection: {}; raise the limit (ulimit -n, LimitNOFILE=)",
                  errno_text(errno)));
}

// Statuses of a session that has done what it was to do: verdicts are results.
bool is_trouble(int status) {
  return status == exit_status::kRuntime || status == exit_status::kUsage || status == exit_status::kDevice;
}

}  // namespace

SupervisedChannel::SupervisedChannel(PortContext context, ChannelSpec spec, bool retries,
                                     std::function<void(int)> on_end)
    : context_(std::move(context)),
      spec_(std::move(spec)),
      retries_(retries),
      on_end_(std::move(on_end)),
      fence_(std::make_shared<Fence>()),
      retry_timer_(*context_.loop, [this] { retry(); }),
      delay_(kFirstDelay) {
  fence_->on_exception = [this, alive = std::weak_ptr<int>(alive_)](const std::string& what) {
    if (!alive.expired()) threw(what);
  };
}

SupervisedChannel::~SupervisedChannel() = default;

Result<void> SupervisedChannel::start() {
  Result<void> started = start_session();
  if (started || !retries_) return started;
  try_again(started.error().message);
  return {};
}

Result<void> SupervisedChannel::start_session() {
  started_ = context_.loop->now();
  Result<void> result;
  context_.loop->within(fence_, [this, &result] {
    try {
      const Result<ChannelPorts> ports = channel_ports(spec_);
      if (!ports) {
        result = ports.error();
        return;
      }
      Result<std::unique_ptr<Channel>> made =
          make_channel(context_, *ports, [this](int exit_status) { session_ended(exit_status); });
      if (made) session_ = std::move(*made);
      result = made ? session_->start() : Result<void>(made.error());
      if (result) result = descriptor_left();
    } catch (const std::exception& error) {  // no thread, no descriptor, …
      result = make_error(Errc::io, error.what());
    }
  });
  if (!result) drop_session();
  return result;
}

void SupervisedChannel::stop() {
  stopping_ = true;
  if (session_) {
    context_.loop->within(fence_, [this] { session_->stop(); });
  } else if (retry_timer_.due()) {
    retry_timer_.cancel();
    later([this] { end(exit_status::kPass); });
  }
}

template <class Request>
Result<void> SupervisedChannel::ask(const Request& what) {
  if (session_) {
    Result<void> done = make_error(Errc::io, "the channel is in trouble");
    context_.loop->within(fence_, [&] { done = session_->request(what); });
    return done;
  }
  return make_error(Errc::usage, "the channel is in trouble: " + trouble_);
}

template Result<void> SupervisedChannel::ask(const RecorderRequest& what);
template Result<void> SupervisedChannel::ask(const PlaybackRequest& what);

ChannelStatus SupervisedChannel::status() const {
  ChannelStatus status = described(spec_);
  status.counters = before_;
  if (session_) {
    status.counters += session_->counters();
    for (Session* const line : session_->sessions()) status.lines.push_back(status_of(*line));
    if (status.lines.empty())  // a port whose connections have a line each
      status.lines.push_back({.state = Session::State::waiting,
                              .driver = session_->driver().name(),
                              .driver_node = {},
                              .device = status.device,
                              .recording = {}});
  } else {
    status.why = trouble_;
    if (const auto due = retry_timer_.due())
      status.retry_in = std::max(*due - context_.loop->now(), Nanos::zero());
  }
  return status;
}

void SupervisedChannel::drop_session() {
  if (session_) before_ += session_->counters();
  session_.reset();
}

void SupervisedChannel::session_ended(int exit_status) {
  drop_session();
  if (retries_ && !stopping_ && is_trouble(exit_status)) {
    try_again(fmt::format("the channel has ended with status {}", exit_status));
  } else {
    end(exit_status);
  }
}

void SupervisedChannel::threw(const std::string& what) {
  if (std::exchange(broken_, true)) return;  // the session ends by the first one
  later([this, what] {                       // its parts are on the stack still
    broken_ = false;
    if (!session_) return;
    drop_session();
    if (retries_ && !stopping_) return try_again(what);
    context_.log->error("{}", what);
    end(exit_status::kRuntime);
  });
}

void SupervisedChannel::later(std::function<void()> task) {
  context_.loop->post([task = std::move(task), alive = std::weak_ptr<int>(alive_)] {
    if (!alive.expired()) task();
  });
}

void SupervisedChannel::try_again(const std::string& why) {
  if (context_.loop->now() - started_ > kLongestDelay) {
    delay_ = kFirstDelay;
    trouble_.clear();
  }
  const bool told = std::exchange(trouble_, why) == why;
  context_.log->log(told ? spdlog::level::debug : spdlog::level::err, "{}; trying again after {} s{}", why,
                    std::chrono::duration_cast<seconds>(delay_).count(), told ? "" : " and longer");
  retry_timer_.set_after(delay_);
  delay_ = std::min(delay_ * 2, kLongestDelay);
}

void SupervisedChannel::retry() {
  if (const Result<void> started = start_session(); !started) {
    try_again(started.error().message);
  } else {
    context_.log->info("the channel has been started again");
  }
}

void SupervisedChannel::end(int exit_status) {
  // The callback may destroy this object, and with it the function.
  const auto on_end = std::exchange(on_end_, {});
  if (on_end) on_end(exit_status);
}

}  // namespace porttape
