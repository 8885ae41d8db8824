#include "tools/test_outcome.hpp"

#include <fmt/format.h>

#include "libport/base/error.hpp"

namespace porttape {
namespace {

// Of a command that did not end well; else empty.
std::string end_text(const TestEnd& end) {
  if (!end.ended_because.empty()) return end.ended_because;
  return end.command.exit_code() == 0 ? std::string() : end.command.text();
}

// Something went wrong that no report has: a connection had no run or was dropped, a tape was given up.
bool failed_beside(const RunReport& report, const TestEnd& end) {
  const int status = end.session_status;
  if (status != exit_status::kRuntime && status != exit_status::kUsage) return false;
  return worse_exit_status(exit_status_of(report), status) != exit_status_of(report);
}

}  // namespace

int exit_status_of(const RunReport& report, const TestEnd& end) {
  if (end.interrupted_by != 0) return 128 + end.interrupted_by;
  if (failed_beside(report, end)) return end.session_status;
  const int status = exit_status_of(report);
  return status == exit_status::kPass && !end.ended_because.empty() ? exit_status::kRuntime : status;
}

std::string outcome_text(const RunReport& report, const TestEnd& end) {
  if (end.interrupted_by != 0) return "interrupted by " + signal_text(end.interrupted_by);
  if (failed_beside(report, end))
    return "failed: not all connections had their run; what went wrong is told above";
  if (!end.opened && !report.trouble) return "incomplete: the command never opened its port";
  const std::string command = end_text(end);
  if (report.verdict != Verdict::pass || report.trouble || command.empty()) return {};
  return "failed: the driver did all as recorded, but the command " + command;
}

std::string command_end_text(const RunReport& report, const TestEnd& end) {
  const bool told_of_command =
      end.opened && !failed_beside(report, end) && !outcome_text(report, end).empty();
  const bool said = end.interrupted_by != 0 || told_of_command;
  if (said || end_text(end).empty()) return {};
  return end_text(end) + (end.hung_up ? "; its line was hung up there (--on-mismatch warn goes on)" : "");
}

}  // namespace porttape
