#include "daemon/daemon.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <fmt/format.h>
#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>
#include <spdlog/spdlog.h>

#include "daemon/channel_check.hpp"

namespace porttape {
namespace {

// Of two exit statuses the one that says more of what went wrong.
int worse(int one, int other) {
  constexpr std::array order = {exit_status::kPass,           exit_status::kIncomplete,
                                exit_status::kTimingMismatch, exit_status::kDataMismatch,
                                exit_status::kDevice,         exit_status::kUsage,
                                exit_status::kRuntime};
  return std::ranges::find(order, one) < std::ranges::find(order, other) ? other : one;
}

}  // namespace

struct Daemon::Signals {
  Signals(Daemon& owner, Loop& loop) : daemon(owner), set(loop.io(), SIGTERM, SIGINT, SIGUSR1) {
    if (!daemon.options_.ignores_hang_up) set.add(SIGHUP);
    set.add(SIGUSR2);
    wait();
  }

  void wait() {
    set.async_wait([this](const boost::system::error_code& error, int number) {
      if (error) return;
      wait();
      if (number == SIGUSR1) return daemon.rotate();
      if (number == SIGHUP) return daemon.hung_up();
      if (number != SIGUSR2) daemon.stop();
    });
  }

  Daemon& daemon;
  boost::asio::signal_set set;
};

Daemon::Daemon(Loop& loop, std::shared_ptr<spdlog::logger> log, Options options)
    : loop_(&loop), log_(std::move(log)), options_(std::move(options)) {
  loop_->on_stall([log = log_](const Stall& stall) {
    log->warn("all lines stood still for {} ms: this process was stopped, got no processor or was held up",
              std::chrono::duration_cast<std::chrono::milliseconds>(stall.length).count());
  });
}
Daemon::~Daemon() = default;

Result<void> Daemon::start(const std::map<std::string, ChannelSpec>& channels) {
  if (Result<void> good = check_channels(channels); !good) return good;
  signals_ = std::make_unique<Signals>(*this, *loop_);
  const bool named = channels.size() > 1;
  PortContext context{loop_, log_};
  for (const auto& [name, spec] : channels) {
    if (named) context.log = log_->clone(name);
    auto channel = std::make_unique<SupervisedChannel>(
        context, spec, options_.keeps_channels,
        [this, name = name](int exit_status) { ended(name, exit_status); });
    if (Result<void> started = channel->start(); !started) return started;
    channels_.emplace(name, std::move(channel));
  }
  return {};
}

int Daemon::run() {
  loop_->run();
  return exit_status_;
}

void Daemon::stop() {
  for (const auto& [name, channel] : channels_) channel->stop();
}

void Daemon::rotate() {
  for (const auto& [name, channel] : channels_) channel->rotate();
}

void Daemon::hung_up() {
  options_.reopen_log();
  if (options_.ends_on_hang_up) stop();
}

void Daemon::ended(const std::string& name, int exit_status) {
  channels_.erase(name);
  exit_status_ = worse(exit_status_, exit_status);
  if (channels_.empty()) loop_->stop();
}

}  // namespace porttape
