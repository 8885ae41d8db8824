#include "daemon/daemon.hpp"

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fmt/format.h>
#include <set>
#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/signal_set.hpp>
#include <spdlog/spdlog.h>

namespace porttape {

struct Daemon::Signals {
  Signals(Daemon& owner, Loop& loop) : daemon(owner), set(loop.io(), SIGTERM, SIGINT, SIGHUP) { wait(); }

  void wait() {
    set.async_wait([this](const boost::system::error_code& error, int number) {
      if (error) return;
      if (number == SIGHUP) {
        daemon.rotate();
      } else {
        daemon.stop();
      }
      wait();
    });
  }

  Daemon& daemon;
  boost::asio::signal_set set;
};

Daemon::Daemon(Loop& loop, std::shared_ptr<spdlog::logger> log) : loop_(&loop), log_(std::move(log)) {
  loop_->on_stall([log = log_](const Stall& stall) {
    log->warn("all lines stood still for {} ms: this process was stopped, got no processor or was held up",
              std::chrono::duration_cast<std::chrono::milliseconds>(stall.length).count());
  });
}
Daemon::~Daemon() = default;

Result<void> Daemon::start(const std::map<std::string, ChannelSpec>& channels) {
  signals_ = std::make_unique<Signals>(*this, *loop_);
  const bool named = channels.size() > 1;
  std::set<std::string> tapes;
  for (const auto& [name, spec] : channels) {
    const auto fail = [&name = name, named](const Error& error) {
      return make_error(error.code,
                        named ? fmt::format("channel '{}': {}", name, error.message) : error.message);
    };
    const Result<ChannelPorts> ports = channel_ports(spec);
    if (!ports) return fail(ports.error());
    if (ports->device.type.ends_with("log")) {
      const std::string tape =
          std::filesystem::absolute(ports->device.text("file")).lexically_normal().string();
      if (!tapes.insert(tape).second) {
        return fail(
            make_error(Errc::usage, fmt::format("tape '{}' is that of another channel; name another", tape)));
      }
    }
    const PortContext context{loop_, named ? log_->clone(name) : log_};
    Result<std::unique_ptr<Session>> session =
        make_session(context, *ports, [this, name = name](int exit_status) { ended(name, exit_status); });
    if (!session) return fail(session.error());
    if (Result<void> started = (*session)->start(); !started) return fail(started.error());
    sessions_.emplace(name, std::move(*session));
  }
  return {};
}

int Daemon::run() {
  loop_->run();
  return exit_status_;
}

void Daemon::stop() {
  for (const auto& [name, session] : sessions_) session->stop();
}

void Daemon::rotate() {
  for (const auto& [name, session] : sessions_) session->rotate();
}

void Daemon::ended(const std::string& name, int exit_status) {
  sessions_.erase(name);
  if (exit_status_ == 0) exit_status_ = exit_status;
  if (sessions_.empty()) loop_->stop();
}

}  // namespace porttape
