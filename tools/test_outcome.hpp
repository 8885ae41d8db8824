#pragma once

#include <string>

#include "libport/replay/report.hpp"
#include "tools/command_end.hpp"

namespace porttape {

// How the command under `porttape test` ended, beside what the run's report says.
struct TestEnd {
  CommandEnd command = {};
  int interrupted_by = 0;  // a signal of the user's; 0: none
  std::string ended_because =
      {};                  // we ended the command: "ran longer than --timeout and was ended"; or empty
  bool hung_up = false;    // its line, at a mismatch
  bool opened = true;      // the port, at least once
  int session_status = 0;  // of all connections, those without a report too
};

// The status that the program ends with.
int exit_status_of(const RunReport& report, const TestEnd& end);

// The first line of what is told, where the report's own does not say why the program ends with that status;
// else empty.
std::string outcome_text(const RunReport& report, const TestEnd& end);

// How the command ended, where that is worth a line of its own: "ended with status 1"; else empty.
std::string command_end_text(const RunReport& report, const TestEnd& end);

}  // namespace porttape
