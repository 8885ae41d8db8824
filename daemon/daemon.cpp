#include "daemon/daemon.hpp"

#include <chrono>
#include <csignal>
#include <fmt/format.h>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/tape/disks.hpp"

namespace porttape {
Daemon::Daemon(Loop& loop, std::shared_ptr<spdlog::logger> log, Options options)
    : loop_(&loop), log_(std::move(log)), options_(std::move(options)) {
  loop_->on_stall([log = log_](const Stall& stall) {
    log->warn("all lines stood still for {} ms: this process was stopped, got no processor or was held up",
              std::chrono::duration_cast<std::chrono::milliseconds>(stall.length).count());
  });
}
Daemon::~Daemon() = default;

Result<void> Daemon::start(const std::map<std::string, ChannelSpec>& channels) {
  signals_.emplace(*loop_, [this](int number) { signalled(number); });
  signals_->add({SIGTERM, SIGINT, SIGUSR1, SIGUSR2});
  if (!options_.ignores_hang_up) signals_->add({SIGHUP});
  const bool named = channels.size() > 1;
  PortContext context{loop_, log_, std::make_shared<Disks>()};
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

void Daemon::signalled(int number) {
  if (number == SIGUSR1) return request(RecorderRequest::next_tape);
  if (number == SIGHUP) return hung_up();
  if (number != SIGUSR2) stop();
}

void Daemon::stop() {
  for (const auto& [name, channel] : channels_) channel->stop();
}

void Daemon::request(RecorderRequest what) {
  for (const auto& [name, channel] : channels_) channel->request(what);
}

void Daemon::hung_up() {
  options_.reopen_log();
  if (options_.ends_on_hang_up) stop();
}

void Daemon::ended(const std::string& name, int exit_status) {
  channels_.erase(name);
  exit_status_ = worse_exit_status(exit_status_, exit_status);
  if (channels_.empty()) loop_->stop();
}

}  // namespace porttape
