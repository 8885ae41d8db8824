#include "tools/test_run.hpp"

#include <algorithm>
#include <chrono>
#include <fmt/format.h>
#include <utility>

#include "libport/catalog/device_group.hpp"
#include "libport/replay/diagnosis.hpp"
#include "libport/taped/types.hpp"

namespace porttape {
namespace {

using std::chrono::seconds;

constexpr Nanos kAfterHangUp = seconds(10);  // a command that goes on after a mismatch is ended then

}  // namespace

TestRun::TestRun(TestRequest request)
    : request_(std::move(request)),
      run_({.name = "porttape test",
            .output_to_stderr = request_.output_to_stderr,
            .supervision = request_.supervision}),
      late_timer_(run_.loop(), [this] { end_late_command(); }),
      idle_timer_(run_.loop(), [this] { look_whether_idle(); }) {}

Result<RunReport> TestRun::run() {
  if (Result<void> started = start_session(); !started) return started.error();
  if (request_.timeout) {
    timeout_at_ = run_.loop().now() + *request_.timeout;
    late_timer_.set(*timeout_at_);
  }
  if (!request_.never_ends) idle_timer_.set_after(IdleWatch::kPeriod);
  if (Result<void> ran = run_.run_command(request_.command); !ran) return ran.error();
  late_timer_.cancel();
  idle_timer_.cancel();
  run_.finish();
  return verdict();
}

Result<void> TestRun::start_session() {
  ChannelPorts ports = request_.ports;
  ReplayOptions options = request_.replay();
  options.report_file.clear();  // written once the command's exit status is known
  options.junit_file.clear();
  options.brief = true;
  options.ends_with_run = true;
  options.looks_on = request_.looks_on;
  options.on_report = [this](const RunReport& report) { take(report); };
  ports.device.set(std::move(options));
  if (request_.record_to) {
    Result<PortSpec> recorded = recorded_replay(ports.device, *request_.record_to);
    if (!recorded) return recorded.error();
    ports.device = std::move(*recorded);
  }
  return run_.start_session(ports);
}

void TestRun::take(const RunReport& report) {
  runs_.add(report);
  const Instant then = run_.loop().now() + kAfterHangUp;
  const bool later = !late_timer_.due() || *late_timer_.due() > then;
  if (is_hung_up(report) && later && !request_.never_ends && run_.command_runs()) late_timer_.set(then);
}

bool TestRun::is_hung_up(const RunReport& report) const {
  return report.mismatch && request_.replay().config.on_mismatch == OnMismatch::fail;
}

bool TestRun::line_is_idle() {
  if (run_.channel() == nullptr) return true;
  const Channel::Counters counters = run_.counters();
  const std::uint64_t bytes = counters.from_driver_bytes + counters.to_driver_bytes + counters.opens;
  const bool due = std::ranges::any_of(
      run_.sessions(), [](Session* each) { return each->device().waiting()->next_due().has_value(); });
  return std::exchange(seen_bytes_, bytes) == bytes && !due;
}

void TestRun::look_whether_idle() {
  // The processes are looked at only where nothing on the line could be late for it.
  const bool idle = line_is_idle() && !run_.family().awake();
  if (idle_.look(run_.loop().now(), idle)) return end_idle_command();
  idle_timer_.set_after(IdleWatch::kPeriod);
}

void TestRun::end_idle_command() {
  const auto limit = std::chrono::duration_cast<seconds>(IdleWatch::kLimit).count();
  run_.notes().push_back(
      fmt::format("for {} s nothing was due, nothing came and the command slept, so it was ended; "
                  "--timeout 0 lets it sleep",
                  limit));
  for (Session* each : run_.sessions()) {
    if (std::string awaits = each->device().waiting()->awaits(); !awaits.empty())
      run_.notes().push_back(std::move(awaits));
  }
  end_command(fmt::format("slept for {} s with nothing more to come, and was ended", limit));
}

void TestRun::end_late_command() {
  const bool timed_out = timeout_at_ && run_.loop().now() >= *timeout_at_;
  if (!timed_out && run_.family().debugged()) {
    late_timer_.set_after(kAfterHangUp);
    return;
  }
  const char* const because = timed_out ? "ran longer than --timeout and was ended"
                                        : "went on after its line was hung up, and was ended";
  end_command(because);
}

void TestRun::end_command(std::string because) {
  idle_timer_.cancel();
  if (run_.ends_command()) return;
  end_.ended_because = std::move(because);
  run_.end_command();
}

Result<RunReport> TestRun::verdict() {
  end_.command = run_.command_end();
  end_.interrupted_by = run_.interrupted_by();
  end_.session_status = run_.session_status();
  end_.opened = run_.counters().opens > 0;
  std::optional<RunReport> report = runs_.worst();
  end_.hung_up = report && is_hung_up(*report);
  const std::size_t connections = tapes_of_group(request_.replay().tape).size();
  if (!request_.ports.each_connection && connections > 1) {
    run_.notes().push_back(fmt::format(
        "the tape is the first of {} that were recorded together; --connections each plays them all",
        connections));
  }
  if (!report) {
    return make_error(run_.session_status() == exit_status::kDevice ? Errc::device_missing : Errc::io,
                      "there was no run; what went wrong is told above");
  }
  if (!end_.opened) report->verdict = Verdict::incomplete;
  if (!end_.opened) {
    run_.notes().emplace_back(
        "it is to open {port}, which stands in COMMAND for the path, or $PORTTAPE_PORT of its environment");
  }
  if (!report->connection) report->tape = request_.replay().tape.name();
  report->command_exit = end_.command.exit_code();
  explain(*report);
  return *report;
}

// What is known of the command may be the reason, or part of it.
void TestRun::explain(RunReport& report) const {
  report.hung = !end_.ended_because.empty() && !end_.hung_up;
  report.repeat_line = request_.repeat_line;
  report.step_line = request_.step_line;
  diagnose(report);
}

}  // namespace porttape
