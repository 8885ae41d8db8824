// `porttape test`: runs shell commands against tapes made here.
#include <cstdlib>
#include <filesystem>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/tools/run.hpp"
#include "tools/test_lines.hpp"

namespace porttape::test {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::MatchesRegex;
using testing::Not;
using testing::StartsWith;

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
  EXPECT_THAT(ran.out, EndsWith(" s\n"));
}

TEST_F(TestVerb, APortThatTheSystemChoosesIsGivenToTheCommand) {
  const Ran ran = run({"test", "--tape", tape, "--driver", "tcp-listen:127.0.0.1:0", "--timeout", "20", "--",
                       "/bin/bash", "-c",
                       "exec 3<>/dev/tcp/{host}/{tcp_port}; echo ask >&3; read answer <&3; "
                       "test \"$answer\" = 42 && test {port} = \"$PORTTAPE_HOST:$PORTTAPE_TCP_PORT\""});
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
}

TEST_F(TestVerb, AWrongRequestIsADataMismatch) {
  const Ran ran = test("exec 3<>{port}; echo axk >&3; read answer <&3");
  EXPECT_EQ(ran.status, 3);
  EXPECT_THAT(ran.out, HasSubstr("data mismatch: the driver wrote \"axk\\n\" where the tape has \"ask\\n\"\n"
                                 "  cause     one byte of request 1 is another: \"x\" (78) where the tape "
                                 "has \"s\" (73), at byte 1\n"
                                 "  at byte 1 of its write no. 1 (byte 1 of all it wrote, "));
}

TEST_F(TestVerb, AFailureEndsWithWhatToTypeNext) {
  const Ran ran = test("exec 3<>{port}; echo axk >&3; read answer <&3");
  const std::string line =
      " --tape " + tape + " --timeout 20 -- /bin/sh -c 'exec 3<>{port}; echo axk >&3; read answer <&3'\n";
  EXPECT_THAT(ran.out, HasSubstr("\n  repeat    porttape test" + line));
  EXPECT_THAT(ran.out, HasSubstr("\n  step      porttape test --timeout 0 --tape " + tape +
                                 " -- /bin/sh -x -c 'exec "));
  EXPECT_THAT(test(kGood).out, Not(HasSubstr("repeat")));
}

TEST_F(TestVerb, ADriverUnderADebuggerIsWhatItsFileIs) {
  const std::string script = dir / "driver";
  write_file(script, as_bytes("#!/usr/bin/env python3\n"));
  const auto step = [this](const std::string& command) {
    return step_line(std::vector<std::string>{"--tape", tape, "--timeout=3", "--", command, "a b"});
  };
  const std::string before = "porttape test --timeout 0 --tape " + tape + " -- ";
  EXPECT_EQ(step(script), before + "python3 -m pdb " + script + " 'a b'");
  EXPECT_EQ(step("python3"), before + "python3 -m pdb 'a b'");
  EXPECT_EQ(step("/bin/sleep"), before + "gdb --args /bin/sleep 'a b'");
  EXPECT_EQ(step("/nowhere"), before + "/nowhere 'a b'");
}

// Three exchanges: a, b and c are answered by A, B and C.
TEST_F(TestVerb, AfterAMismatchTheDriverShowsWhetherItLeftARequestOutOrHasTheOrderWrong) {
  tape = make_tape(dir, "three", {{2000, "A\n"}, {4000, "B\n"}, {6000, "C\n"}},
                   {{1000, "a\n"}, {3000, "b\n"}, {5000, "c\n"}});
  const std::string ask = "exec 3<>{port}; ask() { echo $1 >&3; read answer <&3; }; ";
  // What the driver writes next is awaited for a moment only: one run of five must be quick enough.
  const auto expect = [&](const std::string& command, const std::string& told) {
    Ran ran;
    for (int n = 0; n < 5 && ran.out.find(told) == std::string::npos; ++n) ran = test(command);
    EXPECT_THAT(ran.out, HasSubstr(told));
  };
  expect(ask + "ask b; ask a", "\n  cause     exchanges 1 and 2 swapped: request 2 came first\n");
  expect(ask + "ask b; ask c", "\n  cause     request 1 left out: request 2 came instead\n");
  expect(ask + "ask a; ask a; ask b", "\n  cause     request 1 sent twice before request 2\n");
  // What followed in further writes belongs to it.
  expect(ask + "printf a >&3; printf x >&3; echo y >&3; read answer <&3",
         "two bytes more in request 1: \"xy\" (78 79) at byte 1\n");
}

TEST_F(TestVerb, AMissingRequestIsIncomplete) {
  const Ran ran = test("exec 3<>{port}; printf as >&3");
  EXPECT_EQ(ran.status, 5);
  EXPECT_THAT(ran.out, HasSubstr("incomplete: the driver wrote \"as\" of \"ask\\n\"\n"));
}

TEST_F(TestVerb, AWriteThatComesLateIsShownWithItsText) {
  const Ran ran = test("exec 3<>{port}; sleep 2; echo ask >&3; read answer <&3", {"--strictness", "2"});
  EXPECT_EQ(ran.status, 4);
  EXPECT_THAT(ran.out, MatchesRegex("timing mismatch: \"ask\\\\n\" came [0-9.]+ ms later "
                                    "than recorded \\(100 ms allowed\\)\n.*"));
}

TEST_F(TestVerb, TheEnvironmentHasThePortToo) {
  const Ran ran =
      test("exec 3<>\"$PORTTAPE_PORT\"; echo ask >&3; read answer <&3; test \"$PORTTAPE_PORT\" = {port}");
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
}

TEST_F(TestVerb, ACommandThatNeverOpensThePortIsIncomplete) {
  const Ran ran = test("true");
  EXPECT_EQ(ran.status, 5);
  EXPECT_THAT(ran.out, HasSubstr("incomplete: the command never opened its port\n"));
  EXPECT_THAT(ran.err, HasSubstr("$PORTTAPE_PORT"));
}

TEST_F(TestVerb, AReportThatCannotBeWrittenIsTheOutcome) {
  const std::string why = "report '/dev/full' cannot be written: No space left on device";
  for (const char* option : {"--report", "--junit"}) {
    const Ran ran = test(kGood, {option, "/dev/full"});
    EXPECT_EQ(ran.status, 1);
    EXPECT_THAT(ran.out, StartsWith("failed: " + why + "\n"));
    EXPECT_EQ(ran.err, "porttape test: " + why + "\n");
    const Ran tap = test(kGood, {option, "/dev/full", "--format", "tap"});
    EXPECT_THAT(tap.out, HasSubstr("not ok 1 - "));
    EXPECT_THAT(tap.out, HasSubstr("  message: \"failed: " + why + "\"\n"));
    EXPECT_THAT(test(kGood, {option, "/dev/full", "--format", "json"}).out, HasSubstr("\"exit\":1,"));
  }
}

TEST_F(TestVerb, TheOtherReportSaysThatOneCouldNotBeWritten) {
  const std::string other = dir / "other";
  EXPECT_EQ(test(kGood, {"--report", other, "--junit", "/dev/full"}).status, 1);
  const std::string json(as_text(read_file(other)));
  EXPECT_THAT(json, HasSubstr("\"exit\":1,"));
  EXPECT_THAT(json, HasSubstr("\"outcome\":\"failed: report '/dev/full' cannot be written"));
  EXPECT_EQ(test(kGood, {"--junit", other, "--report", "/dev/full"}).status, 1);
  EXPECT_THAT(std::string(as_text(read_file(other))), HasSubstr(" errors=\"1\" "));
}

TEST_F(TestVerb, AReportThatCannotBeWrittenLeavesTheVerdictToBeRead) {
  const Ran wrong = test("exec 3<>{port}; echo axk >&3; read answer <&3", {"--report", "/dev/full"});
  EXPECT_EQ(wrong.status, 1);
  EXPECT_THAT(wrong.out, StartsWith("failed: report '/dev/full' cannot be written"));
  EXPECT_THAT(wrong.out, HasSubstr("  verdict   data mismatch: "));
  const Ran none = test("true", {"--report", "/dev/full"});
  EXPECT_THAT(none.out, HasSubstr("; otherwise incomplete: the command never opened its port\n"));
}

TEST_F(TestVerb, ACommandThatClosesThePortAtOnceHasOpenedIt) {
  for (int i = 0; i < 30; ++i) {
    const Ran ran = test(": <{port}");
    EXPECT_EQ(ran.status, 5);
    EXPECT_THAT(ran.out, HasSubstr("incomplete: the driver never wrote \"ask\\n\"\n"));
    EXPECT_THAT(ran.out, Not(HasSubstr("never opened")));
  }
}

TEST_F(TestVerb, TheCommandsOwnFailureCountsWhenTheVerdictIsPass) {
  const Ran ran = test(std::string(kGood) + "; exit 7");
  EXPECT_EQ(ran.status, 1);
  EXPECT_THAT(ran.out,
              HasSubstr("failed: the driver did all as recorded, but the command ended with status 7\n"));
  EXPECT_THAT(ran.out, Not(HasSubstr("pass")));
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
  EXPECT_THAT(ran.out, HasSubstr("ran longer than --timeout and was ended"));
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

// Two sessions, each with an exchange of its own.
class TestOfSessions : public TestVerb {
 protected:
  TestOfSessions() {
    tape = make_tape(dir, "two", {{2000, "42\n"}, {102'000, "43\n"}}, {{1000, "ask\n"}, {101'000, "more\n"}},
                     "{\"t_us\":0,\"event\":\"open\"}\n{\"t_us\":9000,\"event\":\"close\"}\n"
                     "{\"t_us\":100000,\"event\":\"open\"}\n{\"t_us\":109000,\"event\":\"close\"}\n");
  }
  static constexpr const char* kSecond =
      "exec 3<>{port}; echo more >&3; read answer <&3; test \"$answer\" = 43";
};

TEST_F(TestOfSessions, BothAreWanted) {
  const Ran both = test(std::string(kGood) + "; exec 3>&-; sleep 0.2; " + kSecond);
  EXPECT_EQ(both.status, 0) << both.out << both.err;
  const Ran one = test(kGood);
  EXPECT_EQ(one.status, 5);
  EXPECT_THAT(one.out, HasSubstr("the tape has two sessions, the driver made one"));
}

TEST_F(TestOfSessions, OneCanBePlayedAlone) {
  const std::string report = dir / "report.json";
  const Ran second = test(kSecond, {"--session", "2", "--report", report});
  EXPECT_EQ(second.status, 0) << second.out << second.err;
  const std::string text(as_text(read_file(report)));
  EXPECT_THAT(text, HasSubstr(R"("from_driver":{"bytes":5,"matched":5,"of":5})"));
  EXPECT_THAT(text, HasSubstr(R"("runs":{"count":1,"looks":0,"worst":"pass")"));
  EXPECT_EQ(test(kGood, {"--session", "1"}).status, 0);
  EXPECT_EQ(test(kGood, {"--session", "2"}).status, 3);
}

TEST_F(TestOfSessions, WhichOneIsChecked) {
  EXPECT_EQ(test(kGood, {"--session", "3"}).status, 2);
  EXPECT_THAT(test(kGood, {"--session", "3"}).err, HasSubstr("has 2 sessions"));
  EXPECT_THAT(test(kGood, {"--session", "0"}).err, HasSubstr("accepted: all, or the number of one session"));
  EXPECT_EQ(test(kGood, {"--session", "one"}).status, 2);
}

TEST_F(TestVerb, ATapeThatCannotBeReadWhenItsTurnComesIsNoPass) {
  make_tape(dir, "t.c2", {{2000, "43\n"}}, {{1000, "more\n"}});
  const Ran ran = run({"test", "--tape", tape, "--timeout", "20", "--driver", "tcp-listen:127.0.0.1:0",
                       "--connections", "each", "--", "/bin/bash", "-c",
                       "rm " + (dir / "t.c2.logr") + " " + (dir / "t.c2.logw") +
                           "; exec 3<>/dev/tcp/{host}/{tcp_port}; echo ask >&3; read answer <&3; test "
                           "\"$answer\" = 42"});
  EXPECT_EQ(ran.status, 2) << ran.out << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("failed: not all connections had their run; what went wrong is told above"));
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
  EXPECT_THAT(ran.out, HasSubstr("Example:\n  porttape test"));
}

}  // namespace
}  // namespace porttape::test
