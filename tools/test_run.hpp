#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "libport/catalog/channel.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/signal_watch.hpp"
#include "libport/loop/timer.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/run_list.hpp"
#include "libport/session/make_session.hpp"
#include "libport/taped/replay_port.hpp"
#include "tools/child_process.hpp"
#include "tools/command_family.hpp"
#include "tools/idle_watch.hpp"

namespace porttape {

// What `porttape test` is to do.
struct TestRequest {
  ChannelPorts ports;
  std::optional<Nanos> timeout;
  bool never_ends = false;  // --timeout 0: the command ends by itself alone
  std::vector<std::string> command;

  [[nodiscard]] const ReplayPort::Options& replay() const { return *ports.device.get<ReplayPort::Options>(); }
};

// One run of a command against a tape: starts both, waits for the command's end, ends what it left running,
// and gives the verdict. Call run() once.
class TestRun {
 public:
  explicit TestRun(TestRequest request);
  ~TestRun();
  TestRun(const TestRun&) = delete;
  TestRun& operator=(const TestRun&) = delete;

  Result<RunReport> run();

  // What the user should know beyond the verdict: a line each.
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }
  // The status that the program ends with, which the report has too.
  [[nodiscard]] int exit_status(const RunReport& report) const;
  [[nodiscard]] const RunList& runs() const { return runs_; }

 private:
  Result<void> start_session();
  Result<void> start_command();
  void signalled(int number);
  void take(const RunReport& report);
  [[nodiscard]] bool is_hung_up(const RunReport& report) const;
  void look_whether_idle();
  [[nodiscard]] bool line_is_idle();
  void end_idle_command();
  void end_late_command();
  void terminate();
  void end_what_is_left();
  Result<RunReport> verdict();

  TestRequest request_;
  CommandFamily family_;
  Loop loop_;
  std::shared_ptr<spdlog::logger> log_;
  std::unique_ptr<Channel> session_;
  std::unique_ptr<ChildProcess> command_;
  RunList runs_;
  std::optional<Instant> timeout_at_;
  Timer kill_timer_;
  Timer idle_timer_;
  IdleWatch idle_;
  std::uint64_t seen_bytes_ = 0;
  std::uint64_t opens_ = 0;
  SignalWatch signals_;
  std::vector<std::string> notes_;
  bool trouble_ = false;  // among the notes is something that a passed test must not have
  int session_status_ = 0;
  int signal_ = 0;  // the one that interrupted the run
  bool terminated_ = false;
};

}  // namespace porttape
