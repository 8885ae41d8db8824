#pragma once

#include <memory>
#include <optional>
#include <string>

#include "libport/catalog/channel.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/signal_watch.hpp"
#include "libport/port/context.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/run_list.hpp"
#include "libport/session/make_session.hpp"
#include "libport/taped/replay_options.hpp"
#include "tools/test_verdict.hpp"

namespace porttape {

// What `porttape drive` is to do: `ports` are of ChannelMode::drive.
struct DriveRequest {
  ChannelPorts ports;
  std::optional<Nanos> silence;  // of the device, after which the run ends

  [[nodiscard]] const ReplayOptions& replay() const { return *ports.driver.get<ReplayOptions>(); }
};

// One run of a tape, in the driver's place, against a device, with the verdict. Call run() once. SIGINT,
// SIGTERM, SIGHUP and SIGQUIT end it, a second one at once.
class DriveRun {
 public:
  explicit DriveRun(DriveRequest request);
  DriveRun(const DriveRun&) = delete;
  DriveRun& operator=(const DriveRun&) = delete;

  // An error where there could be no run: the device is missing, the tape cannot be read. The report's
  // process_exit and outcome say what the verdict does not: a device that was lost, an end by a signal.
  Result<RunReport> run();
  [[nodiscard]] const RunList& runs() const { return runs_; }

 private:
  void signalled(int number);
  void judge(RunReport& report) const;

  DriveRequest request_;
  Loop loop_;
  PortContext context_;
  std::unique_ptr<Channel> channel_;
  Channel::Counters counters_;
  SignalWatch signals_;
  RunList runs_;
  std::optional<RunReport> report_;
  int session_status_ = 0;
  int signal_ = 0;
};

// The same as a verdict, whatever came of it.
TestVerdict drive_device(const DriveRequest& request);

}  // namespace porttape
