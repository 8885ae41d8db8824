#include "libport/replay/test_case.hpp"

#include <chrono>
#include <utility>

#include "libport/base/error.hpp"

namespace porttape {
namespace {

bool is_verdict(int status) {
  return status == exit_status::kDataMismatch || status == exit_status::kTimingMismatch ||
         status == exit_status::kIncomplete;
}

}  // namespace

TestCase test_case_of(const RunReport& report, StrangerText name, StrangerText group) {
  TestCase test{.name = std::move(name), .group = std::move(group), .text = to_text(report)};
  test.exit_status = report.process_exit.value_or(exit_status_of(report));
  test.seconds = std::chrono::duration<double>(report.duration).count();
  for (const Doubt& doubt : report.doubts) test.doubts.emplace_back(doubt.text);
  if (test.exit_status == exit_status::kPass) return test;
  const bool by_verdict = is_verdict(test.exit_status) && !report.trouble;
  test.outcome = by_verdict ? TestCase::Outcome::failed : TestCase::Outcome::error;
  test.kind = by_verdict ? std::string(to_string(report.verdict)) : "failed";
  const std::string& text = test.text.raw();
  test.message = text.substr(0, text.find('\n'));
  return test;
}

void TestCounts::add(const TestCase& test) {
  switch (test.outcome) {
    case TestCase::Outcome::passed:
      ++passed;
      if (!test.doubts.empty()) ++doubtful;
      return;
    case TestCase::Outcome::failed:
      ++failed;
      return;
    case TestCase::Outcome::error:
      ++errors;
      return;
    case TestCase::Outcome::skipped:
      break;
  }
  ++skipped;
}

}  // namespace porttape
