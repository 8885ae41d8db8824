#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/test_case.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;
using testing::Not;

TestCase failing_case(std::string text) {
  return {.name = "a",
          .group = "suite",
          .outcome = TestCase::Outcome::failed,
          .kind = "data-mismatch",
          .message = "data mismatch: …",
          .text = std::move(text),
          .exit_status = 3,
          .seconds = 1.5};
}

TEST(Junit, HasOneSuiteWithItsSums) {
  const std::vector<TestCase> tests = {
      {.name = "good"},
      failing_case("x"),
      {.name = "broken", .outcome = TestCase::Outcome::error, .message = "no tape"},
      {.name = "later", .outcome = TestCase::Outcome::skipped, .message = "no device yet"}};
  const std::string xml = to_junit("the suite", tests, 2);
  EXPECT_THAT(xml, HasSubstr("<testsuite name=\"the suite\" tests=\"4\" failures=\"1\" errors=\"1\" "
                             "skipped=\"1\" time=\"2.000000\">"));
  EXPECT_THAT(xml,
              HasSubstr("<testcase name=\"a\" classname=\"suite\" time=\"1.500000\">\n"
                        "      <failure message=\"data mismatch: …\" type=\"data-mismatch\">x</failure>\n"));
  EXPECT_THAT(xml, HasSubstr("<error message=\"no tape\" type=\"\"></error>"));
  EXPECT_THAT(xml, HasSubstr("<skipped message=\"no device yet\"/>"));
}

TEST(Junit, ATestThatPassedWithDoubtsHasItsReport) {
  RunReport report;
  report.tape = "laser.log";
  const TestCase sure = test_case_of(report, "laser", "s");
  EXPECT_TRUE(sure.doubts.empty());
  EXPECT_THAT(to_junit("s", {&sure, 1}, 0), Not(HasSubstr("system-out")));
  report.doubts.push_back({Doubt::Kind::unread, "2 bytes\nwere not read"});
  TestCase test = test_case_of(report, "laser", "s");
  test.output = "what it wrote";
  EXPECT_EQ(test.outcome, TestCase::Outcome::passed);
  EXPECT_EQ(test.doubts, std::vector<StrangerText>{"2 bytes\nwere not read"});
  const std::string xml = to_junit("s", {&test, 1}, 0);
  EXPECT_THAT(xml, HasSubstr("<system-out>pass, with doubts  "));
  EXPECT_THAT(xml, HasSubstr("  doubt     2 bytes\\nwere not read\nwhat it wrote</system-out>"));
  TestCounts counts;
  counts.add(sure);
  counts.add(test);
  EXPECT_EQ(counts.passed, 2U);
  EXPECT_EQ(counts.doubtful, 1U);
}

TEST(Junit, NothingInATextIsMarkup) {
  TestCase test = failing_case("a < b && \"c\" > ]]>");
  test.name = "<\"&\n'>";
  const std::string xml = to_junit("s", {&test, 1}, 0);
  EXPECT_THAT(xml, HasSubstr(">a &lt; b &amp;&amp; &quot;c&quot; &gt; ]]&gt;<"));
  EXPECT_THAT(xml, HasSubstr("name=\"&lt;&quot;&amp;\\n'&gt;\""));
}

TEST(Junit, WhatXmlCannotHoldIsEscaped) {
  const std::string xml =
      to_junit("s", std::vector{failing_case("one\r\ntwo\tthree\x1b[31m\x01\xff\xEF\xBF\xBE ü")}, 0);
  EXPECT_THAT(xml, HasSubstr("one\ntwo\tthree\\x1b[31m\\x01\\xff\\u{fffe} ü"));
}

TEST(Junit, ARunIsATestWithItsReportAsText) {
  RunReport report;
  report.tape = "laser.log";
  report.verdict = Verdict::incomplete;
  const TestCase test = test_case_of(report, "laser", "s");
  EXPECT_EQ(test.outcome, TestCase::Outcome::failed);
  EXPECT_EQ(test.kind, "incomplete");
  EXPECT_EQ(test.exit_status, 5);
  EXPECT_EQ(test.text.raw(), to_text(report));
  EXPECT_THAT(test.message.raw(), Not(HasSubstr("\n")));
  report.verdict = Verdict::pass;
  EXPECT_EQ(test_case_of(report, "laser", "s").outcome, TestCase::Outcome::passed);
  report.process_exit = 1;
  EXPECT_EQ(test_case_of(report, "laser", "s").outcome, TestCase::Outcome::error);
}

}  // namespace
}  // namespace porttape
