// `porttape test`: runs shell commands against tapes made here.
#include <cstdlib>
#include <filesystem>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/tools/run.hpp"

namespace porttape::test {
namespace {

using testing::HasSubstr;

class TestVerb : public testing::Test {
 protected:
  // One exchange: "ask\n" is answered by "42\n".
  TestVerb() : tape(make_tape(dir, "t", {{2000, "42\n"}}, {{1000, "ask\n"}})) {}

  Ran test(const std::string& command, std::vector<std::string> options = {}) const {
    options.insert(options.begin(), {"test", "--tape", tape, "--timeout", "20"});
    options.insert(options.end(), {"--", "/bin/sh", "-c", command});
    return run(options);
  }

  TempDir dir;
  std::string tape;
};

// Reads one line of the answer, so that it ends only when that has come.
constexpr const char* kGood = "exec 3<>{port}; echo ask >&3; read answer <&3; test \"$answer\" = 42";

TEST_F(TestVerb, PassesWhenTheCommandDoesAsRecorded) {
  const Ran ran = test(kGood);
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("pass"));
}

TEST_F(TestVerb, APortThatTheSystemChoosesIsGivenToTheCommand) {
  const Ran ran =
      run({"test", "--tape", tape, "--driver", "tcp-listen:127.0.0.1:0", "--timeout", "20", "--", "/bin/bash",
           "-c",
           "place={port}; exec 3<>/dev/tcp/${place%:*}/${place#*:}; echo ask >&3; read answer <&3; "
           "test \"$answer\" = 42"});
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
}

TEST_F(TestVerb, AWrongRequestIsADataMismatch) {
  const Ran ran = test("exec 3<>{port}; echo axk >&3; read answer <&3");
  EXPECT_EQ(ran.status, 3);
  EXPECT_THAT(ran.out, HasSubstr("byte 1 "));
}

TEST_F(TestVerb, AMissingRequestIsIncomplete) { EXPECT_EQ(test("exec 3<>{port}; printf as >&3").status, 5); }

TEST_F(TestVerb, ACommandThatNeverOpensThePortIsIncomplete) {
  const Ran ran = test("true");
  EXPECT_EQ(ran.status, 5);
  EXPECT_THAT(ran.err, HasSubstr("never opened"));
}

TEST_F(TestVerb, TheCommandsOwnFailureCountsWhenTheVerdictIsPass) {
  const Ran ran = test(std::string(kGood) + "; exit 7");
  EXPECT_EQ(ran.status, 1);
  EXPECT_THAT(ran.err, HasSubstr("status 7"));
}

TEST_F(TestVerb, AProbeBeforeTheSessionDoesNotSpoilTheVerdict) {
  const Ran ran = test(std::string(": <{port}; sleep 0.2; ") + kGood);
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
}

TEST_F(TestVerb, TheReportHasTheCommandsStatus) {
  const std::string report = dir / "report.json";
  EXPECT_EQ(test(std::string(kGood) + "; exit 7", {"--report", report}).status, 1);
  const Bytes bytes = read_file(report);
  EXPECT_THAT(std::string(as_text(bytes)), HasSubstr(R"("verdict":"pass")"));
  EXPECT_THAT(std::string(as_text(bytes)), HasSubstr(R"("command_exit":7)"));
}

TEST_F(TestVerb, ACommandThatTakesTooLongIsEnded) {
  const Ran ran = run({"test", "--tape", tape, "--timeout", "0.2", "--", "/bin/sleep", "1000"});
  EXPECT_NE(ran.status, 0);
  EXPECT_THAT(ran.err, HasSubstr("--timeout"));
}

TEST_F(TestVerb, ASessionThatEndsBeforeTheCommandIsNoHarm) {
  const Ran ran = test(std::string(kGood) + "; sleep 0.3", {"--at-end", "exit"});
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
}

TEST_F(TestVerb, TheUnopenedRunsReportHasTheTapesTotals) {
  const std::string report = dir / "report.json";
  EXPECT_EQ(test("true", {"--report", report, "--rate", "2"}).status, 5);
  const Bytes bytes = read_file(report);
  const std::string text(as_text(bytes));
  EXPECT_THAT(text, HasSubstr(R"("rate":2)"));
  EXPECT_THAT(text, HasSubstr(R"("to_driver":{"bytes":0,"of":3})"));
}

TEST_F(TestVerb, UsageErrorsAreTwo) {
  EXPECT_EQ(run({"test", "--tape", tape}).status, 2);
  EXPECT_EQ(run({"test", "--tape", tape, "--", "/no/such/program"}).status, 2);
  EXPECT_EQ(run({"test", "--tape", dir / "none", "--", "true"}).status, 2);
  EXPECT_EQ(run({"test", "--tape", tape, "--strictness", "3", "--", "true"}).status, 2);
  EXPECT_EQ(run({"test", "--tape", tape, "--strict", "1", "--", "true"}).status, 2);
  EXPECT_EQ(run({"test", "--tape", tape, "--report", "/no/such/folder/r", "--", "true"}).status, 2);
}

TEST_F(TestVerb, LeavesNothingBehind) {
  const std::string temporary = dir / "tmp";
  std::filesystem::create_directory(temporary);
  ::setenv("TMPDIR", temporary.c_str(), 1);
  (void)test(kGood);
  ::unsetenv("TMPDIR");
  EXPECT_TRUE(std::filesystem::is_empty(temporary));
}

TEST_F(TestVerb, ACommandWithoutTheDashesBeforeItIsShownWithThem) {
  EXPECT_EQ(
      run({"test", "--tape", "x", "./driver", "--device", "{port}", "a b"}).err,
      "porttape test: -- is missing before the command; type porttape test --tape x -- ./driver --device "
      "{port} 'a b'\n");
  EXPECT_EQ(run({"test", "x", "--", "true"}).err,
            "porttape test: --tape is missing before 'x'; type porttape test --tape x -- true\n");
  EXPECT_THAT(run({"test", "--tape", "x", "y", "--", "true"}).err, HasSubstr("'y' is not an option"));
}

TEST_F(TestVerb, HelpHasAnExample) {
  const Ran ran = run({"test", "--help"});
  EXPECT_EQ(ran.status, 0);
  EXPECT_THAT(ran.out, HasSubstr("Example: porttape test"));
}

}  // namespace
}  // namespace porttape::test
