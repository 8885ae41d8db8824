// `porttape test`: how a run ends, what counts as one, and what the program ends with.
#include <cerrno>
#include <signal.h>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/tools/run.hpp"
#include "tools/idle_watch.hpp"

namespace porttape::test {
namespace {

using testing::HasSubstr;

class TestVerbEnds : public testing::Test {
 protected:
  TestVerbEnds() : tape(make_tape(dir, "t", {{2000, "42\n"}}, {{1000, "ask\n"}})) {}

  Ran test(const std::string& command, std::vector<std::string> options = {}) const {
    options.insert(options.begin(), {"test", "--tape", tape, "--report", report});
    options.insert(options.end(), {"--", "/bin/sh", "-c", command});
    return run(options);
  }
  [[nodiscard]] std::string text(const std::string& file) const {
    const Bytes bytes = read_file(file);
    return std::string(as_text(bytes));
  }
  // Of the process whose id the command wrote into `pid`.
  [[nodiscard]] bool lives() const { return ::kill(std::stoi(text(pid)), 0) == 0 || errno != ESRCH; }

  TempDir dir;
  std::string tape;
  std::string report = dir / "report.json";
  std::string pid = dir / "pid";
  const std::string good = "exec 3<>{port}; echo ask >&3; read answer <&3; test \"$answer\" = 42";
};

TEST_F(TestVerbEnds, ALookBeforeOrAfterTheRunDoesNotSpoilIt) {
  for (const char* strictness : {"0", "1", "2"}) {
    const Ran ran = test(": <{port}; sleep 0.2; " + good + "; exec 3>&-; sleep 0.2; : <{port}; sleep 0.2",
                         {"--strictness", strictness, "--jitter", "60000"});
    EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
    EXPECT_THAT(text(report), HasSubstr(R"("verdict":"pass","exit":0,)"));
  }
}

TEST_F(TestVerbEnds, NothingButALookIsIncompleteAtAnyStrictness) {
  for (const char* strictness : {"0", "1"}) {
    EXPECT_EQ(test(": <{port}", {"--strictness", strictness}).status, 5);
    EXPECT_THAT(text(report), HasSubstr(R"("verdict":"incomplete","exit":5,)"));
  }
}

TEST_F(TestVerbEnds, WhereBothReportsWouldGoToOnePlaceTheRefusalIsTheReportAlone) {
  const Ran ran = test(good, {"--junit", dir / "./report.json"});
  EXPECT_EQ(ran.status, 2) << ran.out << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("report.json' has the report already; name another file"));
  EXPECT_THAT(text(report), testing::StartsWith("{"));
  EXPECT_THAT(text(report), testing::Not(HasSubstr("<testsuites")));
}

TEST_F(TestVerbEnds, TheReportsExitIsTheProcesss) {
  EXPECT_EQ(test(good + "; exit 7").status, 1);
  EXPECT_THAT(text(report), HasSubstr(R"("verdict":"pass","exit":1,)"));
  EXPECT_EQ(test(good + "; sleep 1000", {"--timeout", "3"}).status, 1);
  EXPECT_THAT(text(report), HasSubstr(R"("verdict":"pass","exit":1,)"));
}

TEST_F(TestVerbEnds, WhatTheCommandLeftRunningIsEndedAndNamed) {
  const Ran ran = test(good + "; sleep 1000 & echo $! >" + pid);
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("left running, now ended: "));
  EXPECT_THAT(ran.err, HasSubstr("(pid " + std::to_string(std::stoi(text(pid))) + ")"));
  EXPECT_FALSE(lives());
}

TEST_F(TestVerbEnds, ADaemonOfTheCommandIsEndedToo) {
  const Ran ran = test(good + "; setsid sh -c 'sleep 1000 & echo $! >" + pid + "'; exit 0");
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
  EXPECT_FALSE(lives());
}

TEST_F(TestVerbEnds, InterruptedItGives130And143) {
  EXPECT_EQ(test("kill -INT $PPID; sleep 1000").status, 130);
  EXPECT_THAT(text(report), HasSubstr(R"("exit":130,)"));
  EXPECT_EQ(test(good + "; kill -TERM $PPID; sleep 1000").status, 143);
  EXPECT_THAT(text(report), HasSubstr(R"("verdict":"pass","exit":143,)"));
}

TEST(IdleWatch, EndsOnlyAfterTenSecondsWithoutABreak) {
  const auto at = [](int s) { return Instant{} + std::chrono::seconds(s); };
  IdleWatch watch;
  EXPECT_FALSE(watch.look(at(1), true));
  EXPECT_FALSE(watch.look(at(10), true));
  EXPECT_FALSE(watch.look(at(11), false));
  EXPECT_FALSE(watch.look(at(12), true));
  EXPECT_FALSE(watch.look(at(21), true));
  EXPECT_TRUE(watch.look(at(22), true));
}

}  // namespace
}  // namespace porttape::test
