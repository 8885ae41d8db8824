#include "tools/drive_run.hpp"

#include <signal.h>
#include <utility>

#include <spdlog/logger.h>

#include "libport/catalog/device_group.hpp"
#include "libport/tape/disks.hpp"
#include "libport/tape/source_mode.hpp"
#include "tools/command_end.hpp"
#include "tools/tool_log.hpp"
#include "tools/verb_clock.hpp"

namespace porttape {

DriveRun::DriveRun(DriveRequest request)
    : request_(std::move(request)),
      context_{.loop = &loop_,
               .log = make_tool_log("porttape drive", spdlog::level::err),
               .disks = std::make_shared<Disks>(),
               .announces = false},
      signals_(loop_, [this](int number) { signalled(number); }) {}

Result<RunReport> DriveRun::run() {
  ReplayOptions options = request_.replay();
  options.report_file.clear();  // written once the exit status is known
  options.junit_file.clear();
  options.silence = request_.silence;
  options.on_report = [this](const RunReport& report) {
    runs_.add(report);
    report_ = report;
  };
  request_.ports.driver.set(std::move(options));
  Result<std::unique_ptr<Channel>> made = make_channel(context_, request_.ports, [this](int exit_status) {
    session_status_ = exit_status;
    counters_ = channel_->counters();
    channel_.reset();
  });
  if (!made) return made.error();
  channel_ = std::move(*made);
  for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) {
    if (!is_ignored(number)) signals_.add({number});
  }
  if (Result<void> started = channel_->start(); !started) {
    channel_.reset();
    return started.error();
  }
  for (Session* session : channel_->sessions()) {
    const Port& device = session->device();
    if (device.passive()) context_.log->error("the device is to come to {}", device.place().text());
  }
  while (channel_) loop_.run_one();
  if (!report_) return make_error(Errc::io, "there was no run; what went wrong is told above");
  judge(*report_);
  return *report_;
}

void DriveRun::signalled(int number) {
  if (signal_ == 0) signal_ = number;
  if (channel_) channel_->stop();
}

// Other bytes are a finding whatever became of the device then.
void DriveRun::judge(RunReport& report) const {
  const bool lost = counters_.device_losses > 0 || session_status_ == exit_status::kDevice;
  const int verdict = exit_status_of(report);
  if (signal_ != 0) {
    report.process_exit = 128 + signal_;
    report.outcome = "interrupted by " + signal_text(signal_);
  } else if (lost && (verdict == exit_status::kIncomplete || report.nobody_came)) {
    report.process_exit = exit_status::kDevice;
    report.outcome = "failed: the device was lost or could not be opened; what went wrong is told above";
  } else if (!report.outcome.empty()) {
    report.outcome = "incomplete: " + report.outcome;
  }
}

TestVerdict drive_device(const DriveRequest& request) {
  const Instant begun = verb_clock().now();
  DriveRun run(request);
  Result<RunReport> report = run.run();
  TestVerdict verdict = report ? TestVerdict{.report = std::move(*report)}
                               : no_test(request.replay().tape.name(), report.error());
  verdict.kept = kept_from_others(tapes_of_group(request.replay().tape));
  verdict.report.writer = Writer::device;
  verdict.seconds = std::chrono::duration<double>(verb_clock().now() - begun).count();
  if (!verdict.error) verdict.runs = run.runs().json();
  return verdict;
}

}  // namespace porttape
