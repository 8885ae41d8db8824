#include "tools/test_run.hpp"

#include <algorithm>
#include <chrono>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <signal.h>
#include <string_view>
#include <utility>

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include "libport/port/printable_message.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {
namespace {

using std::chrono::seconds;

constexpr Nanos kAfterHangUp = seconds(10);  // a command that goes on after a mismatch is ended then
constexpr Nanos kAfterTerm = seconds(5);     // … and killed then
constexpr Nanos kLeftTerm = seconds(2);      // what the command left running: between SIGTERM and SIGKILL
constexpr Nanos kLeftKill = seconds(1);

std::vector<std::string> with_port(std::vector<std::string> command, const std::string& port) {
  constexpr std::string_view placeholder = "{port}";
  for (std::string& argument : command) {
    for (std::size_t at = 0; (at = argument.find(placeholder, at)) != std::string::npos; at += port.size()) {
      argument.replace(at, placeholder.size(), port);
    }
  }
  return command;
}

std::string names_of(const std::vector<ProcessState>& processes) {
  std::vector<std::string> names;
  for (const ProcessState& process : processes)
    names.push_back(fmt::format("{} (pid {})", process.name, process.pid));
  return fmt::format("{}", fmt::join(names, ", "));
}

bool is_ignored(int signal_number) {
  struct sigaction action {};
  return ::sigaction(signal_number, nullptr, &action) == 0 && action.sa_handler == SIG_IGN;
}

}  // namespace

TestRun::TestRun(TestRequest request)
    : request_(std::move(request)),
      log_(std::make_shared<spdlog::logger>("porttape", std::make_shared<spdlog::sinks::stderr_sink_mt>())),
      kill_timer_(loop_, [this] { end_late_command(); }),
      idle_timer_(loop_, [this] { look_whether_idle(); }),
      signals_(loop_, [this](int number) { signalled(number); }) {
  log_->set_level(spdlog::level::err);
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  formatter->add_flag<PrintableMessage>('v').set_pattern("porttape: %v");
  log_->set_formatter(std::move(formatter));
}

TestRun::~TestRun() = default;

Result<RunReport> TestRun::run() {
  if (Result<void> adopted = family_.adopt(); !adopted) return adopted.error();
  if (Result<void> started = start_session(); !started) return started.error();
  if (Result<void> started = start_command(); !started) return started.error();
  while (command_->running()) loop_.run_one();
  while (loop_.poll_one()) {  // what the command did last
  }
  kill_timer_.cancel();
  idle_timer_.cancel();
  if (session_) session_->stop();
  end_what_is_left();
  while (session_) loop_.run_one();
  return verdict();
}

Result<void> TestRun::start_session() {
  ChannelPorts ports = request_.ports;
  ReplayPort::Options options = request_.replay();
  options.report_file.clear();  // written once the command's exit status is known
  options.brief = true;
  options.on_report = [this](const RunReport& report) { take(report); };
  ports.device.set(std::move(options));
  Result<std::unique_ptr<Channel>> made = make_channel({&loop_, log_}, ports, [this](int status) {
    session_status_ = status;
    opens_ = session_->counters().opens;
    session_.reset();
  });
  if (!made) return made.error();
  session_ = std::move(*made);
  return session_->start();
}

Result<void> TestRun::start_command() {
  const std::string name = session_->driver().name();
  const std::string port = name.substr(name.find(':') + 1);
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) {
    if (!is_ignored(number)) signals_.add({number});
  }
  Result<std::unique_ptr<ChildProcess>> command =
      ChildProcess::start(loop_, with_port(request_.command, port), [] {});
  if (!command) return command.error();
  command_ = std::move(*command);
  if (request_.timeout) {
    timeout_at_ = Loop::now() + *request_.timeout;
    kill_timer_.set(*timeout_at_);
  }
  if (!request_.never_ends) idle_timer_.set_after(IdleWatch::kPeriod);
  return {};
}

// The command gets the signal, then a while to end; a second signal ends it at once.
void TestRun::signalled(int number) {
  if (!command_) return;
  command_->kill(signal_ != 0 ? SIGKILL : number);
  if (signal_ == 0) signal_ = number;
  terminated_ = true;
  kill_timer_.set_after(kAfterTerm);
}

void TestRun::take(const RunReport& report) {
  runs_.add(report);
  const Instant then = Loop::now() + kAfterHangUp;
  const bool later = !kill_timer_.due() || *kill_timer_.due() > then;
  if (is_hung_up(report) && later && !request_.never_ends && command_ && command_->running())
    kill_timer_.set(then);
}

bool TestRun::is_hung_up(const RunReport& report) const {
  return report.mismatch && request_.replay().config.on_mismatch == OnMismatch::fail;
}

bool TestRun::line_is_idle() {
  if (!session_) return true;
  const Channel::Counters counters = session_->counters();
  const std::uint64_t bytes = counters.from_driver_bytes + counters.to_driver_bytes + counters.opens;
  const std::vector<Session*> sessions = session_->sessions();
  const bool due = std::ranges::any_of(
      sessions, [](Session* each) { return each->device().waiting()->next_due().has_value(); });
  return std::exchange(seen_bytes_, bytes) == bytes && !due;
}

void TestRun::look_whether_idle() {
  // The processes are looked at only where nothing on the line could be late for it.
  const bool idle = line_is_idle() && !family_.awake();
  if (idle_.look(Loop::now(), idle)) return end_idle_command();
  idle_timer_.set_after(IdleWatch::kPeriod);
}

void TestRun::end_idle_command() {
  notes_.push_back(
      fmt::format("for {} s nothing was due, nothing came and the command slept, so it was ended; "
                  "--timeout 0 lets it sleep",
                  std::chrono::duration_cast<seconds>(IdleWatch::kLimit).count()));
  for (Session* each : session_ ? session_->sessions() : std::vector<Session*>()) {
    if (std::string awaits = each->device().waiting()->awaits(); !awaits.empty())
      notes_.push_back(std::move(awaits));
  }
  terminate();
}

void TestRun::end_late_command() {
  if (terminated_) {
    command_->kill(SIGKILL);
    return;
  }
  const bool timed_out = timeout_at_ && Loop::now() >= *timeout_at_;
  if (!timed_out && family_.debugged()) {
    kill_timer_.set_after(kAfterHangUp);
    return;
  }
  notes_.emplace_back(timed_out ? "the command ran longer than --timeout and was ended"
                                : "the command went on after its line was hung up, and was ended");
  terminate();
}

void TestRun::terminate() {
  idle_timer_.cancel();
  if (std::exchange(terminated_, true)) return;
  trouble_ = true;
  command_->kill(SIGTERM);
  kill_timer_.set_after(kAfterTerm);
}

void TestRun::end_what_is_left() {
  const CommandFamily::Ended family = family_.end(kLeftTerm, kLeftKill);
  if (!family.ended.empty())
    notes_.push_back(fmt::format("the command left running, now ended: {}", names_of(family.ended)));
  if (!family.left.empty())
    notes_.push_back(
        fmt::format("the command left running, and it cannot be ended: {}", names_of(family.left)));
}

Result<RunReport> TestRun::verdict() {
  std::optional<RunReport> report = runs_.worst();
  if (!report) {
    return make_error(session_status_ == exit_status::kDevice ? Errc::device_missing : Errc::io,
                      "there was no run; what went wrong is told above");
  }
  if (opens_ == 0) {
    notes_.emplace_back("the command never opened the port");
    trouble_ = true;
  }
  if (!report->connection) report->tape = request_.replay().tape.name();
  report->command_exit = command_->exit_code();
  return *report;
}

int TestRun::exit_status(const RunReport& report) const {
  if (signal_ != 0) return 128 + signal_;
  const int status = exit_status_of(report);
  return status == exit_status::kPass && trouble_ ? exit_status::kRuntime : status;
}

}  // namespace porttape
