// `porttape test --suite`: folders of tapes made here, with shell commands.
#include <fstream>
#include <string>
#include <unistd.h>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/tools/run.hpp"
#include "tools/suite_file.hpp"

namespace porttape::test {
namespace {

using testing::ContainsRegex;
using testing::EndsWith;
using testing::HasSubstr;
using testing::MatchesRegex;
using testing::Not;
using testing::StartsWith;

constexpr const char* kGoodSuite =
    R"(command = "exec 3<>{port}; echo ask >&3; read answer <&3; test \"$answer\" = 42")";

class Suites : public testing::Test {
 protected:
  Suites() { make_tape(dir, "t", {{2000, "42\n"}}, {{1000, "ask\n"}}); }

  void write(const std::string& text) const { std::ofstream(dir / "suite.toml") << text; }
  Ran run_suite_with_doubts(std::vector<std::string> options = {}) const {
    options.insert(options.begin(), {"test", "--suite", dir / "", "-j", "3", "--timeout", "20"});
    return run_with_doubts(options);
  }
  Ran run_suite(std::vector<std::string> options = {}) const {
    Ran ran = run_suite_with_doubts(std::move(options));
    ran.out = without_doubts(std::move(ran.out));
    return ran;
  }
  // What is wrong with a suite, without the folder's name.
  std::string problem(const std::string& text) const {
    write(text);
    const Ran ran = run_suite();
    EXPECT_EQ(ran.status, 2) << ran.out;
    const std::size_t at = ran.err.find("suite.toml");
    return at == std::string::npos ? ran.err : ran.err.substr(at);
  }

  TempDir dir;
};

TEST_F(Suites, WithOneCommandEachTapeIsATest) {
  make_tape(dir, "u", {{2000, "42\n"}}, {{1000, "ask\n"}});
  make_tape(dir, "u.c2", {}, {});
  write(kGoodSuite);
  const Ran ran = run_suite();
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
  EXPECT_THAT(ran.out, MatchesRegex("pass  .*: 2 tests, 2 passed, 0 failed, 0 skipped, [0-9.]+ s\n"));
}

TEST_F(Suites, OnlyFailuresAreShownAndHowToRunThemAgain) {
  write(std::string(kGoodSuite) +
        "\n[[test]]\ntape = \"t\"\n"
        "[[test]]\nname = \"wrong\"\ntape = \"t\"\ncommand = \"echo hallo; echo axk >{port}; sleep 0.1\"\n");
  const Ran ran = run_suite();
  EXPECT_EQ(ran.status, 3) << ran.out << ran.err;
  EXPECT_THAT(ran.out, StartsWith("FAIL  wrong\n    data mismatch: the driver wrote \"axk\\n\""));
  EXPECT_THAT(ran.out, HasSubstr("    what the command wrote:\n    hallo\n"));
  EXPECT_THAT(ran.out, HasSubstr("    again     porttape test --suite " + (dir / "") + " --only wrong\n"));
  EXPECT_THAT(ran.out, HasSubstr(": 2 tests, 1 passed, 1 failed, 0 skipped, "));
  const Ran again = run_suite({"--only", "wro*"});
  EXPECT_THAT(again.out, HasSubstr(": 1 test, 0 passed, 1 failed, 0 skipped, "));
}

TEST_F(Suites, OfWhatACommandWroteTheLastTwentyLinesAreShown) {
  const auto shown = [this](const std::string& command) {
    write("[[test]]\nname = \"wrong\"\ntape = \"t\"\ncommand = \"" + command + "; false\"\n");
    return run_suite().out;
  };
  EXPECT_THAT(shown("seq 20"), HasSubstr("    what the command wrote:\n    1\n    2\n"));
  EXPECT_THAT(shown("seq 21"), HasSubstr("    what the command wrote:\n    ...\n    2\n    3\n"));
  EXPECT_THAT(shown("seq 300"), HasSubstr("    what the command wrote:\n    ...\n    281\n    282\n"));
}

// The driver leaves its last answer unread.
TEST_F(Suites, ATestThatPassedWithDoubtsSaysSoInEachFormat) {
  make_tape(dir, "doubtful", {{2000, "42\n"}}, {{1000, "ask\n"}});
  write("[[test]]\ntape = \"doubtful\"\ncommand = \"exec 3<>{port}; echo ask >&3; sleep 0.1\"\n");
  const Ran text = run_suite_with_doubts({"--junit", dir / "j.xml"});
  EXPECT_EQ(text.status, 0) << text.out << text.err;
  EXPECT_THAT(text.out, StartsWith("pass, with doubts  doubtful\n    doubt     3 bytes of 3 (100.0 %)"));
  EXPECT_THAT(text.out, HasSubstr(": 1 test, 1 passed (1 with doubts), 0 failed, 0 skipped, "));
  EXPECT_THAT(std::string(as_text(read_file(dir / "j.xml"))), HasSubstr("<system-out>pass, with doubts  "));
  const std::string tap = run_suite_with_doubts({"--format", "tap"}).out;
  EXPECT_THAT(tap, HasSubstr("ok 1 - doubtful\n# doubt: 3 bytes of 3 (100.0 %)"));
  const std::string json = run_suite_with_doubts({"--format", "json"}).out;
  EXPECT_THAT(json, HasSubstr("\"doubts\":[\"3 bytes of 3 (100.0 %)"));
  EXPECT_THAT(json, HasSubstr("\"passed\":1,\"doubtful\":1,"));
}

TEST_F(Suites, TheWorstTestsStatusIsTheSuites) {
  write(std::string(kGoodSuite) +
        "\n[[test]]\nname = \"incomplete\"\ntape = \"t\"\ncommand = \"printf as >{port}; sleep 0.1\"\n"
        "[[test]]\nname = \"wrong\"\ntape = \"t\"\ncommand = \"echo axk >{port}; sleep 0.1\"\n");
  EXPECT_EQ(run_suite().status, 3);
  EXPECT_EQ(run_suite({"--only", "incomplete"}).status, 5);
}

TEST_F(Suites, AnErrorOfOneTestLeavesTheOthersAlone) {
  write(std::string(kGoodSuite) +
        "\n[[test]]\ntape = \"t\"\n"
        "[[test]]\ntape = \"no-such\"\n"
        "[[test]]\nname = \"no command\"\ntape = \"t\"\ncommand = [\"./no-such\"]\n"
        "[[test]]\nname = \"killer\"\ntape = \"t\"\ncommand = \"kill -9 $PPID; sleep 100\"\n");
  const std::string junit = dir / "junit.xml";
  const Ran once = run_suite({"--junit", junit});
  EXPECT_EQ(once.status, 1) << once.out << once.err;
  EXPECT_THAT(once.out, HasSubstr("FAIL  no-such\n    no tape 'no-such': there is neither"));
  EXPECT_THAT(once.out, HasSubstr("FAIL  no command\n    command './no-such' cannot be run: No such file"));
  EXPECT_THAT(once.out, HasSubstr("FAIL  killer\n    its process was ended by SIGKILL (9)\n"));
  EXPECT_THAT(once.out, HasSubstr(": 4 tests, 1 passed, 3 failed, 0 skipped, "));
  const std::string xml(as_text(read_file(junit)));
  EXPECT_THAT(xml, HasSubstr(" tests=\"4\" failures=\"0\" errors=\"3\" skipped=\"0\" "));
  EXPECT_THAT(xml, HasSubstr("<testcase name=\"killer\" "));
}

TEST_F(Suites, CommandsRunInTheFolderWithNothingOnStdin) {
  std::ofstream(dir / "here") << "yes";
  write(R"(command = "test -e here && ! read word; exec 3<>{port}; echo ask >&3; read answer <&3")");
  const Ran ran = run_suite();
  EXPECT_EQ(ran.status, 0) << ran.out;
}

TEST_F(Suites, ASkippedTestSaysWhy) {
  write("[[test]]\ntape = \"t\"\nskip = \"no device # yet\"\n");
  EXPECT_THAT(run_suite({"--format", "tap"}).out, HasSubstr("ok 1 - t # SKIP no device # yet\n"));
  EXPECT_THAT(run_suite().out, HasSubstr("0 passed, 0 failed, 1 skipped"));
}

TEST_F(Suites, TapIsInTheSuitesOrder) {
  write(std::string(kGoodSuite) +
        "\n[[test]]\nname = \"a #1 \\\\\"\ntape = \"t\"\n"
        "[[test]]\nname = \"b\"\ntape = \"t\"\ncommand = \"true\"\n");
  const Ran ran = run_suite({"--format", "tap"});
  EXPECT_THAT(ran.out, StartsWith("TAP version 13\n1..2\nok 1 - a \\#1 \\\\\nnot ok 2 - b\n  ---\n  message: "
                                  "\"incomplete: the command never opened its port\"\n"));
  EXPECT_THAT(ran.out, EndsWith("  ...\n"));
}

TEST_F(Suites, JsonHasALineForEachTestAndOneForAll) {
  write(kGoodSuite);
  const Ran ran = run_suite({"--format", "json"});
  EXPECT_THAT(ran.out, StartsWith(R"({"test":"t","outcome":"pass","exit":0,)"));
  EXPECT_THAT(ran.out, HasSubstr(R"("report":{"verdict":"pass",)"));
  EXPECT_THAT(ran.out, HasSubstr("\n{\"suite\":"));
  EXPECT_THAT(
      ran.out,
      ContainsRegex(R"("exit":0,"tests":1,"passed":1,"doubtful":[01],"failed":0,"errors":0,"skipped":0,)"));
}

TEST_F(Suites, WhatTheCommandLineSaysHoldsForAllTests) {
  write(std::string(kGoodSuite) + "\nstrictness = 2\ntiming = \"none\"\n");
  EXPECT_EQ(run_suite().status, 2);
  EXPECT_EQ(run_suite({"--strictness", "1"}).status, 0);
  EXPECT_THAT(run_suite({"--tape", "t"}).err, HasSubstr("'tape' is of one test, and does not go with"));
}

TEST_F(Suites, WhatIsWrongIsToldWithFileLineAndKey) {
  EXPECT_EQ(problem("\nstricness = 1\n"),
            "suite.toml:2: unknown key 'stricness'; did you mean 'strictness'?\n");
  EXPECT_THAT(problem("strictness = 3\n"), StartsWith("suite.toml:1: key 'strictness': "));
  EXPECT_THAT(problem("[[test]]\ncommand = \"x\"\n"), StartsWith("suite.toml:1: key 'tape' is missing"));
  EXPECT_THAT(problem("[[test]]\ntape = \"t\"\n"), StartsWith("suite.toml:1: key 'command' is missing"));
  EXPECT_THAT(problem("command = []\n"), StartsWith("suite.toml:1: key 'command' is empty"));
  EXPECT_THAT(problem("command = 3\n"), StartsWith("suite.toml:1: key 'command' is no text"));
  EXPECT_THAT(problem("test = 3\n"), StartsWith("suite.toml:1: key 'test' is no list"));
  EXPECT_THAT(problem("check-settings = 1\n"), StartsWith("suite.toml:1: key 'check-settings' is true or"));
  EXPECT_THAT(problem("report = \"x\"\n"), StartsWith("suite.toml:1: unknown key 'report'"));
  EXPECT_THAT(problem(std::string(kGoodSuite) + "\n[[test]]\ntape=\"t\"\n\n[[test]]\ntape=\"t\"\n"),
              StartsWith("suite.toml:5: a second test is named 't'"));
  EXPECT_THAT(problem("a = [\n"), StartsWith("suite.toml:"));
  EXPECT_THAT(problem("# nothing\n"), HasSubstr("no test is in it"));
}

TEST_F(Suites, AFolderWithoutAFileSaysSo) {
  EXPECT_THAT(run_suite().err, HasSubstr("there is no suite.toml in it"));
  EXPECT_EQ(run_suite().status, 2);
}

TEST_F(Suites, TapesThatNoTestHasAreTold) {
  make_tape(dir, "forgotten", {}, {});
  write("[[test]]\ntape = \"t\"\nskip = \"x\"\n");
  EXPECT_THAT(run_suite().err, HasSubstr("no test has forgotten.log; give each a [[test]]"));
}

TEST_F(Suites, ATestWithTheNameOfTheFoldersOtherTapeIsRefused) {
  make_tape(dir, "other", {}, {});
  const std::string text =
      std::string(kGoodSuite) + "\n[[test]]\nname = \"t\"\ntape = \"other\"\nskip = \"later\"\n";
  EXPECT_THAT(problem(text),
              StartsWith("suite.toml:2: the test of tape 'other' is named 't', as is that of the "
                         "folder's tape 't.log'; give it another name"));
  write(text + "[[test]]\nname = \"mine\"\ntape = \"t\"\n");
  EXPECT_THAT(run_suite().out, HasSubstr(": 2 tests, 1 passed, 0 failed, 1 skipped"));
}

TEST_F(Suites, ATapeOfWhichOnlyTheEventsAreLeftIsATestThatFails) {
  write_file(dir / "lost.loge", bytes_of(std::string(kEventsHeader)));
  write(kGoodSuite);
  const Ran ran = run_suite();
  EXPECT_EQ(ran.status, 2) << ran.out;
  EXPECT_THAT(ran.out, HasSubstr("FAIL  lost\n"));
  EXPECT_THAT(ran.out, HasSubstr("whose r and w files are missing"));
}

TEST_F(Suites, OnlyNumbersOfConnectionsMakeATapeALaterConnection) {
  for (const char* const name : {"t.c0", "t.c1", "t.c02", "t.c2"})
    make_tape(dir, name, {{2000, "42\n"}}, {{1000, "ask\n"}});
  write(kGoodSuite);
  EXPECT_THAT(run_suite().out, HasSubstr(": 4 tests, 4 passed"));
}

TEST_F(Suites, ALaterConnectionThatNoTestPlaysIsTold) {
  make_tape(dir, "t.c2", {}, {});
  write(kGoodSuite);
  EXPECT_THAT(run_suite().err, HasSubstr("no test plays t.c2.log, a later connection of t.log; connections"));
  write("connections = \"each\"\n" + std::string(kGoodSuite));
  EXPECT_THAT(run_suite().err, Not(HasSubstr("t.c2.log")));
  write(std::string(kGoodSuite) + "\n[[test]]\ntape = \"t.c2\"\nskip = \"x\"\n");
  EXPECT_EQ(run_suite().err, "");
}

TEST_F(Suites, ATapeWithoutTheUsualEndingIsTold) {
  write_file(dir / "bootr", block_bytes({}));
  write_file(dir / "bootw", block_bytes({}));
  write(kGoodSuite);
  EXPECT_THAT(run_suite().err, HasSubstr("no test has boot, whose name does not end in .log; give each"));
  write(std::string(kGoodSuite) + "\n[[test]]\ntape = \"boot\"\nskip = \"x\"\n");
  EXPECT_EQ(run_suite().err, "");
}

TEST_F(Suites, ANameForAllTestsIsRefused) {
  EXPECT_THAT(problem("name = \"t\"\n"), StartsWith("suite.toml:1: key 'name' is of one test"));
}

TEST_F(Suites, AJunitFileThatCannotBeWrittenIsToldBeforeAnythingRuns) {
  write("command = \"touch ran\"\n");
  EXPECT_EQ(run_suite({"--junit", "/no/such/folder/j.xml"}).status, 2);
  EXPECT_NE(::access((dir / "ran").c_str(), F_OK), 0);
}

TEST_F(Suites, AJunitFileThatCannotBeWrittenIsTheOutcome) {
  write(kGoodSuite);
  const std::string why = "report '/dev/full' cannot be written: No space left on device";
  const Ran text = run_suite({"--junit", "/dev/full"});
  EXPECT_EQ(text.status, 1);
  EXPECT_THAT(text.out, HasSubstr("failed: " + why + "  "));
  EXPECT_THAT(text.out, HasSubstr(", 1 passed, 0 failed, "));
  EXPECT_THAT(text.out, Not(HasSubstr("pass  ")));
  EXPECT_EQ(text.err, "porttape test: " + why + "\n");
  const Ran tap = run_suite({"--junit", "/dev/full", "--format", "tap"});
  EXPECT_EQ(tap.status, 1);
  EXPECT_THAT(tap.out, EndsWith("Bail out!  " + why + "\n"));
  const Ran json = run_suite({"--junit", "/dev/full", "--format", "json"});
  EXPECT_THAT(json.out, HasSubstr("\"exit\":1,\"tests\":1,\"passed\":1,"));
  EXPECT_THAT(json.out, HasSubstr("\"trouble\":\"" + why + "\""));
}

TEST_F(Suites, OneThatCannotBeginSaysSoInTheJunitFileAndInTap) {
  write("colour = 1\n");
  const Ran ran = run_suite({"--junit", dir / "j.xml", "--format", "tap"});
  EXPECT_EQ(ran.status, 2);
  EXPECT_THAT(ran.out, MatchesRegex("Bail out!  .*suite.toml:1: .*\n"));
  EXPECT_THAT(std::string(as_text(read_file(dir / "j.xml"))), HasSubstr("errors=\"1\""));
}

}  // namespace
}  // namespace porttape::test
