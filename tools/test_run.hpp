#pragma once

#include <optional>
#include <string>
#include <vector>

#include "libport/loop/timer.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/run_list.hpp"
#include "tools/command_run.hpp"
#include "tools/idle_watch.hpp"
#include "tools/test_outcome.hpp"
#include "tools/test_request.hpp"

namespace porttape {

// One run of a command against a tape, with the verdict. Call run() once.
class TestRun {
 public:
  explicit TestRun(TestRequest request);
  TestRun(const TestRun&) = delete;
  TestRun& operator=(const TestRun&) = delete;

  Result<RunReport> run();
  // From a callback of its ports: ends the command now.
  void kill() { run_.kill_command(); }

  // After run(): how the command ended, and what the user should know beyond the verdict, a line each.
  [[nodiscard]] const TestEnd& end() const { return end_; }
  [[nodiscard]] const std::vector<std::string>& notes() const { return run_.notes(); }
  [[nodiscard]] const RunList& runs() const { return runs_; }

 private:
  Result<void> start_session();
  void take(const RunReport& report);
  [[nodiscard]] bool is_hung_up(const RunReport& report) const;
  void look_whether_idle();
  [[nodiscard]] bool line_is_idle();
  void end_idle_command();
  void end_late_command();
  void end_command(std::string because);
  Result<RunReport> verdict();
  void explain(RunReport& report) const;

  TestRequest request_;
  CommandRun run_;
  TestEnd end_;
  RunList runs_;
  std::optional<Instant> timeout_at_;
  Timer late_timer_;
  Timer idle_timer_;
  IdleWatch idle_;
  std::uint64_t seen_bytes_ = 0;
};

}  // namespace porttape
