#include "tools/command_run.hpp"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <optional>
#include <signal.h>
#include <system_error>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/supervise/tap_calls.hpp"
#include "libport/supervise/tty_calls.hpp"
#include "libport/tape/disks.hpp"
#include "tools/found_port.hpp"
#include "tools/supervised_child.hpp"
#include "tools/tool_log.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;

constexpr Nanos kOpening =
    std::chrono::seconds(2);  // of a device that is still being opened at the command's end
constexpr Nanos kLastWords = milliseconds(100);  // for what the command did last; a device may never pause
constexpr Nanos kAfterTerm = std::chrono::seconds(5);  // a command that was asked to end is killed then

void replace_all(std::string& text, std::string_view what, const std::string& by) {
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += by.size()) {
    text.replace(at, what.size(), by);
  }
}

// A command may change its folder.
PortPlace absolute(PortPlace place) {
  std::error_code error;
  const std::filesystem::path path = std::filesystem::absolute(place.path, error);
  if (!place.path.empty() && !error) place.path = path.string();
  return place;
}

std::string names_of(const std::vector<ProcessState>& processes) {
  std::vector<std::string> names;
  for (const ProcessState& process : processes)
    names.push_back(fmt::format("{} (pid {})", process.name, process.pid));
  return fmt::format("{}", fmt::join(names, ", "));
}

}  // namespace

std::vector<std::string> with_place(std::vector<std::string> command, const PortPlace& place) {
  for (std::string& argument : command) {
    replace_all(argument, "{port}", place.text());
    if (place.host.empty()) continue;
    replace_all(argument, "{host}", place.host);
    replace_all(argument, "{tcp_port}", std::to_string(place.port));
  }
  return command;
}

ChildProcess::Environment environment_of(const PortPlace& place) {
  const bool socket = !place.host.empty();
  return {{"PORTTAPE_PORT", place.text()},
          {"PORTTAPE_HOST", socket ? std::optional(place.host) : std::nullopt},
          {"PORTTAPE_TCP_PORT", socket ? std::optional(std::to_string(place.port)) : std::nullopt}};
}

CommandRun::CommandRun(Options options)
    : options_(std::move(options)),
      context_{.loop = &loop_,
               .log = make_tool_log(options_.name, options_.log_level),
               .disks = std::make_shared<Disks>(),
               .announces = false},
      kill_timer_(loop_, [this] { kill_command(); }),
      signals_(loop_, [this](int number) { signalled(number); }) {}

CommandRun::~CommandRun() = default;

Result<void> CommandRun::start_session(const ChannelPorts& ports) {
  if (Result<void> adopted = family_.adopt(); !adopted) return adopted.error();
  Result<std::unique_ptr<Channel>> made =
      make_channel(context_, ports, [this](int exit_status) { session_ended(exit_status); });
  if (!made) return made.error();
  channel_ = std::move(*made);
  Result<void> begun = channel_->start();
  if (!begun) channel_.reset();
  return begun;
}

void CommandRun::session_ended(int exit_status) {
  session_status_ = exit_status;
  counters_ = channel_->counters();
  channel_.reset();
  if (options_.on_session_end) options_.on_session_end(exit_status);
}

Result<void> CommandRun::start_command(const std::vector<std::string>& command) {
  const PortPlace place = absolute(channel_->driver().place());
  const std::vector<std::string> placed = with_place(command, place);
  const ChildProcess::Environment environment = environment_of(place);
  const auto output =
      options_.output_to_stderr ? ChildProcess::Output::all_to_stderr : ChildProcess::Output::ours;
  if (options_.supervision) {
    const Result<bool> supervised = start_supervised(command, place, output);
    if (!supervised) return supervised.error();
    if (*supervised) return {};
  }
  Result<std::unique_ptr<ChildProcess>> started =
      ChildProcess::start(loop_, placed, environment, output, [] {});
  if (!started) return started.error();
  command_ = std::move(*started);
  return {};
}

Result<std::vector<std::unique_ptr<CallPart>>> CommandRun::supervising_parts() {
  std::vector<std::unique_ptr<CallPart>> parts;
  const auto tell = [log = context_.log](const std::string& what) { log->warn("{}", what); };
  if (const std::shared_ptr<TappedLine>& tapped = options_.supervision->tapped) {
    const auto processes = [this] {
      std::vector<pid_t> pids;
      for (const ProcessState& process : family_.members()) pids.push_back(process.pid);
      return pids;
    };
    parts.push_back(std::make_unique<TapCalls>(
        loop_, *tapped,
        TapCalls::Options{
            .device = options_.supervision->tapped_device, .processes = processes, .tell = tell}));
    return parts;
  }
  SupervisedLine* const line = channel_->driver().supervised();
  if (line == nullptr) {
    return make_error(Errc::usage,
                      fmt::format("{} is no tty: only a command that opens one can be supervised; "
                                  "leave out --driver, or name a pty",
                                  channel_->driver().name()));
  }
  parts.push_back(std::make_unique<TtyCalls>(*line, options_.supervision->lines, tell));
  return parts;
}

// False: this machine forbids it, which is told.
Result<bool> CommandRun::start_supervised(const std::vector<std::string>& command, PortPlace place,
                                          ChildProcess::Output output) {
  Result<std::vector<std::unique_ptr<CallPart>>> parts = supervising_parts();
  if (!parts) return parts.error();
  const bool tapped = options_.supervision->tapped != nullptr;
  std::optional<DevicePort> found;
  if (!tapped) {
    found = port_to_find(*options_.supervision, channel_->driver(),
                         sessions().empty() ? nullptr : &sessions().front()->device(), *context_.log);
  }
  if (found) place = {.path = found->identity.path};
  std::string forbidden;
  Result<std::unique_ptr<SupervisedChild>> started = SupervisedChild::start(
      loop_, std::move(*parts),
      {.command = with_place(command, place),
       .environment = environment_of(place),
       .output = output,
       .found_as = found},
      forbidden, [log = context_.log](const std::string& what) { log->error("{}", what); });
  if (!started) return started.error();
  if (!*started && tapped) {
    return make_error(Errc::io,
                      forbidden +
                          "; record by a pty: porttape record --device PORT --tape NAME -- COMMAND…, "
                          "with {port} in COMMAND for the port");
  }
  if (!*started) {
    context_.log->error("{}; the command runs without a supervisor, on a plain pty", forbidden);
    return false;
  }
  family_.look_through((*started)->guard());
  command_ = std::move(*started);
  most_files_.emplace();  // of all programs that the command runs, each may need some at a time
  return true;
}

Result<void> CommandRun::run_command(const std::vector<std::string>& command) {
  watch_signals();
  if (Result<void> started = start_command(command); !started) return started;
  while (command_->running()) loop_.run_one();
  kill_timer_.cancel();
  handle_ready();
  wait_for_device();
  handle_ready();
  return {};
}

// What came with the command's end; not for ever, on a line without a pause.
void CommandRun::handle_ready() {
  const Instant until = loop_.now() + kLastWords;
  while (loop_.now() < until && loop_.poll_one()) {
  }
}

// What a quick command wrote before the device was open waits for that.
void CommandRun::wait_for_device() {
  const auto is_opening = [](Session* session) { return session->state() == Session::State::opening; };
  const Instant until = loop_.now() + kOpening;
  Timer wakes(loop_, [] {});
  wakes.set(until);
  while (std::ranges::any_of(sessions(), is_opening) && loop_.now() < until && signal_ == 0) loop_.run_one();
}

void CommandRun::finish() {
  finishing_ = true;
  if (channel_) channel_->stop();
  end_what_is_left();
  while (channel_) loop_.run_one();
}

void CommandRun::watch_signals() {
  for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) {
    if (!is_ignored(number)) signals_.add({number});
  }
  signals_.add({SIGUSR1});
}

// The command gets the signal, then a while to end. What a terminal sends it has got already. After the
// command it is the second stop, and only that: before the first it would cost what is still to be passed on.
void CommandRun::signalled(int number) {
  if (!command_runs()) {
    if (finishing_ && channel_ && number != SIGUSR1) channel_->stop();
    return;
  }
  if (number == SIGUSR1) {
    if (channel_) (void)channel_->request(RecorderRequest::next_tape());
    return;
  }
  if (std::exchange(signal_, number) != 0) return kill_command();
  if (!signals_.from_terminal() || !command_->in_our_group()) command_->kill(number);
  ending_ = true;
  if (!options_.waits_after_signal) kill_timer_.set_after(kAfterTerm);
}

void CommandRun::end_command() {
  if (std::exchange(ending_, true) || !command_runs()) return;
  command_->kill(SIGTERM);
  kill_timer_.set_after(kAfterTerm);
}

void CommandRun::kill_command() {
  if (command_runs()) command_->kill(SIGKILL);
}

void CommandRun::end_what_is_left() {
  const CommandFamily::Ended family = family_.end(CommandFamily::kTermLimit, CommandFamily::kKillLimit);
  if (!family.ended.empty())
    notes_.push_back(fmt::format("the command left running, now ended: {}", names_of(family.ended)));
  if (!family.left.empty())
    notes_.push_back(
        fmt::format("the command left running, and it cannot be ended: {}", names_of(family.left)));
  if (family.unseen)
    notes_.push_back(
        "the command left processes running, which are not ended: /proc is of another PID namespace and "
        "does not show which; mount it anew");
}

}  // namespace porttape
