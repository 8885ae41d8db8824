#include "daemon/daemon.hpp"

#include <chrono>
#include <csignal>
#include <fmt/format.h>
#include <unistd.h>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/base/version.hpp"
#include "libport/tape/disks.hpp"

namespace porttape {
Daemon::Daemon(Loop& loop, std::shared_ptr<spdlog::logger> log, Options options)
    : loop_(&loop), log_(std::move(log)), options_(std::move(options)), since_(loop.clock().wall()) {
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
    const auto trouble = std::make_shared<LastTrouble>();
    context.log = log_->clone(named ? name : log_->name());
    context.log->sinks().push_back(trouble);
    context.log->set_level(
        std::min(context.log->level(), spdlog::level::warn));  // the log's own sink has its level
    auto channel = std::make_unique<SupervisedChannel>(
        context, spec, options_.keeps_channels,
        [this, name = name](int exit_status) { ended(name, exit_status); });
    if (Result<void> started = channel->start(); !started) return started;
    channels_.emplace(name, Running{std::move(channel), trouble});
  }
  return {};
}

int Daemon::run() {
  loop_->run();
  return exit_status_;
}

void Daemon::signalled(int number) {
  if (number == SIGUSR1) {
    // Before the first open there is nothing to do, and that is no news.
    for (const auto& [name, channel] : channels_)
      (void)channel.running->request(RecorderRequest::next_tape());
  } else if (number == SIGHUP) {
    hung_up();
  } else if (number != SIGUSR2) {
    stop();
  }
}

void Daemon::stop() {
  for (const auto& [name, channel] : channels_) channel.running->stop();
}

// The channels that are meant.
Result<std::vector<std::string>> Daemon::running(const std::string& channel) const {
  std::vector<std::string> names;
  for (const auto& [name, running] : channels_) names.push_back(name);
  if (channel.empty()) return names;
  if (channels_.contains(channel)) return std::vector{channel};
  if (ended_.contains(channel)) return make_error(Errc::io, fmt::format("channel '{}' has ended", channel));
  return make_error(Errc::usage,
                    fmt::format("there is no channel '{}'; known: {}", channel, fmt::join(names, ", ")));
}

Result<Daemon::Outcome> Daemon::record(const std::string& channel, const RecorderRequest& what) {
  return ask(channel, what, "none of the channels takes a mark");
}

Result<Daemon::Outcome> Daemon::play(const std::string& channel, const PlaybackRequest& what) {
  return ask(channel, what, "none of the channels does that");
}

// `none`: says that, where several channels were asked.
template <class Request>
Result<Daemon::Outcome> Daemon::ask(const std::string& channel, const Request& what, std::string_view none) {
  const auto names = running(channel);
  if (!names) return names.error();
  Outcome outcome;
  for (const std::string& name : *names) {
    if (const Result<void> made = channels_.at(name).running->request(what); made) {
      outcome.done.push_back(name);
    } else {
      outcome.refused.emplace_back(name, made.error().message);
    }
  }
  if (!outcome.done.empty()) return outcome;
  std::string why = "no channel is there any more";
  if (!outcome.refused.empty()) why = outcome.refused.front().second;
  if (outcome.refused.size() > 1) why = fmt::format("{}; {}: {}", none, outcome.refused.front().first, why);
  return make_error(Errc::io, why);
}

Result<Daemon::Outcome> Daemon::stop(const std::string& channel) {
  const auto names = running(channel);
  if (!names) return names.error();
  for (const std::string& name : *names) channels_.at(name).running->stop();
  return Outcome{*names, {}};
}

std::string Daemon::status() const {
  JsonList list;
  for (const auto& [name, channel] : channels_) {
    ChannelStatus now = channel.running->status();
    now.trouble = channel.trouble->told();
    list.add(to_json(name, now));
  }
  for (const auto& [name, channel] : ended_) list.add(to_json(name, channel));
  JsonObject json;
  json.add("pid", ::getpid())
      .add("verb", options_.verb)
      .add("tool", "porttape " + std::string(version()))
      .add("since", wall_text(since_))
      .add("channels", list);
  return json.str();
}

void Daemon::hung_up() {
  options_.reopen_log();
  if (options_.ends_on_hang_up) stop();
}

void Daemon::ended(const std::string& name, int exit_status) {
  const Running& channel = channels_.at(name);
  ChannelStatus last = channel.running->status();
  last.ended = exit_status;
  last.trouble = channel.trouble->told();
  ended_.insert_or_assign(name, std::move(last));
  channels_.erase(name);
  exit_status_ = worse_exit_status(exit_status_, exit_status);
  if (channels_.empty()) loop_->stop();
}

}  // namespace porttape
