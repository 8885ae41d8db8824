#include "tools/test_verdict.hpp"

#include <chrono>
#include <utility>

#include "libport/catalog/device_group.hpp"
#include "libport/tape/source_mode.hpp"
#include "tools/test_outcome.hpp"
#include "tools/test_run.hpp"
#include "tools/verb_clock.hpp"

namespace porttape {

TestCase TestVerdict::as_case(std::string name, std::string group) const {
  TestCase test = test_case_of(report, std::move(name), std::move(group));
  if (error) test.message = error->message;
  std::string text = error ? error->message + '\n' : test.text.raw();
  for (const std::string& note : notes) text += "  note      " + note + '\n';
  test.text = std::move(text);
  test.seconds = seconds;
  return test;
}

TestVerdict run_one_test(const TestRequest& request) {
  const auto begun = verb_clock().now();
  TestRun test(request);
  Result<RunReport> report = test.run();
  TestVerdict verdict = report ? TestVerdict{.report = std::move(*report)}
                               : no_test(request.replay().tape.name(), report.error());
  verdict.kept = kept_from_others(tapes_of_group(request.replay().tape));
  verdict.notes = test.notes();
  verdict.seconds = std::chrono::duration<double>(verb_clock().now() - begun).count();
  if (verdict.error) return verdict;
  verdict.runs = test.runs().json();
  verdict.report.outcome = outcome_text(verdict.report, test.end());
  verdict.report.command_end = command_end_text(verdict.report, test.end());
  verdict.report.process_exit = exit_status_of(verdict.report, test.end());
  return verdict;
}

TestVerdict no_test(std::string tape, Error error) {
  TestVerdict verdict;
  verdict.report.verdict = Verdict::incomplete;
  verdict.report.nobody_came = true;
  verdict.report.tape = std::move(tape);
  verdict.report.trouble = error.message;
  verdict.report.process_exit = exit_status_of(error.code);
  verdict.error = std::move(error);
  return verdict;
}

}  // namespace porttape
