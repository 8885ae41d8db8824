#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "libport/replay/report.hpp"

namespace porttape {

// A test that was run, as the formats of test runners have it. Its texts are a stranger's: of a suite's file,
// of a tape, of the command.
struct TestCase {
  enum class Outcome : std::uint8_t {
    passed,
    failed,   // the verdict says so: exit status 3, 4 or 5
    error,    // the verdict is not what failed: the command, the tape, the system
    skipped,  // `message` says why
  };

  StrangerText name = {};
  StrangerText group = {};  // the suite it belongs to
  Outcome outcome = Outcome::passed;
  std::string kind = {};      // "data-mismatch", "incomplete", …; what kind of failure
  StrangerText message = {};  // in one line
  StrangerText text = {};     // all of it, as a person reads it
  StrangerText output = {};   // what the command wrote, where that was kept
  // What makes the outcome doubtful. A test that passed with doubts has not simply passed, and every format
  // says so.
  std::vector<StrangerText> doubts = {};
  int exit_status = 0;
  double seconds = 0;
};

// The test that a run was; to_text(report) is its text.
TestCase test_case_of(const RunReport& report, StrangerText name, StrangerText group);

struct TestCounts {
  std::size_t passed = 0;
  std::size_t failed = 0;
  std::size_t errors = 0;
  std::size_t skipped = 0;
  std::size_t doubtful = 0;  // of those that passed

  void add(const TestCase& test);
  [[nodiscard]] std::size_t all() const { return passed + failed + errors + skipped; }
};

// A JUnit file: `<testsuites>` with one `<testsuite>` of that name. `seconds` is what all of it took.
std::string to_junit(std::string_view suite, std::span<const TestCase> tests, double seconds);

}  // namespace porttape
