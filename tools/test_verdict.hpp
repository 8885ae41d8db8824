#pragma once

#include <string>
#include <sys/types.h>
#include <vector>

#include "libport/base/error.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/test_case.hpp"
#include "tools/test_request.hpp"

namespace porttape {

// What came of one test, whatever it was: a run has a report, and so has one that could not be.
struct TestVerdict {
  RunReport report;
  std::string runs = {};  // JSON, as to_json() takes it
  std::vector<std::string> notes = {};
  double seconds = 0;
  std::optional<Error> error = {};  // there was no run
  mode_t kept = 0;                  // from others, by the tapes: kept_from_others()

  [[nodiscard]] int exit_status() const { return report.process_exit.value_or(exit_status_of(report)); }
  [[nodiscard]] TestCase as_case(std::string name, std::string group) const;
  [[nodiscard]] std::string json() const { return to_json(report, runs); }
};

// Runs the command against the tape.
TestVerdict run_one_test(const TestRequest& request);
// Of a test that could not begin.
TestVerdict no_test(std::string tape, Error error);

}  // namespace porttape
