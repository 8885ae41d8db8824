// Drivers that hang, crash, flood or leave processes behind: each is named, nothing of it is left, and the
// reports are written.
#include <cerrno>
#include <fstream>
#include <signal.h>
#include <string>
#include <sys/types.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/tools/run.hpp"

namespace porttape::test {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

struct BadDriver {
  std::string name;
  std::string command;  // it may leave the pid of a process in the file `pid`
  int status;
  std::string told;  // on stdout or stderr
  const char* timeout = "60";
};

void PrintTo(const BadDriver& driver, std::ostream* out) { *out << driver.name; }

constexpr const char* kAsk = "exec 3<>{port}; echo ask >&3; read answer <&3; ";

class BadDriversTape : public testing::Test {
 protected:
  // One exchange: "ask\n" is answered by "42\n".
  BadDriversTape() : tape(make_tape(dir, "t", {{2000, "42\n"}}, {{1000, "ask\n"}})) {}

  // Its process is gone, if it told of one.
  void expect_gone() const {
    std::ifstream file(dir / "pid");
    pid_t pid = 0;
    if (!(file >> pid)) return;
    EXPECT_EQ(::kill(pid, 0), -1) << "process " << pid << " is left";
    EXPECT_EQ(errno, ESRCH);
  }

  TempDir dir;
  std::string tape;
};

class BadDrivers : public BadDriversTape, public testing::WithParamInterface<BadDriver> {};

TEST_P(BadDrivers, IsNamedAndEndedAndTheReportsAreWritten) {
  const std::string report = dir / "report.json";
  const std::string junit = dir / "junit.xml";
  const Ran ran = run({"test", "--tape", tape, "--timeout", GetParam().timeout, "--report", report, "--junit",
                       junit, "--", "/bin/bash", "-c", "cd " + (dir / "") + "; " + GetParam().command});
  EXPECT_EQ(ran.status, GetParam().status) << ran.out << ran.err;
  EXPECT_THAT(ran.out + ran.err, HasSubstr(GetParam().told));
  expect_gone();
  EXPECT_THAT(std::string(as_text(read_file(report))), StartsWith("{\"verdict\":"));
  EXPECT_THAT(std::string(as_text(read_file(junit))), HasSubstr("</testsuites>"));
}

INSTANTIATE_TEST_SUITE_P(
    Each, BadDrivers,
    testing::Values(
        BadDriver{"hangs", std::string(kAsk) + "echo $$ >pid; exec sleep 1000", 1,
                  "ran longer than --timeout and was ended", "2"},
        // It is killed five seconds later.
        BadDriver{"ignores_sigterm",
                  std::string("trap '' TERM; ") + kAsk + "echo $$ >pid; while :; do sleep 0.1; done", 1,
                  "ran longer than --timeout and was ended", "2"},
        BadDriver{"crashes", std::string(kAsk) + "kill -SEGV $$", 1, "was ended by SIGSEGV (11)"},
        BadDriver{"forks", std::string(kAsk) + "sleep 1000 & echo $! >pid", 0,
                  "the command left running, now ended: "},
        BadDriver{"daemonises",
                  std::string(kAsk) +
                      "setsid sh -c 'setsid sh -c \"echo \\$\\$ >pid; exec sleep 1000\" & wait' & "
                      "until [[ -s pid ]]; do sleep 0.01; done",
                  0, "the command left running, now ended: "},
        BadDriver{"a_daemon_that_ignores_sigterm",
                  std::string(kAsk) +
                      "setsid sh -c 'trap \"\" TERM; echo $$ >pid; while :; do sleep 0.1; done' & "
                      "until [[ -s pid ]]; do sleep 0.01; done",
                  0, "the command left running, now ended: "},
        BadDriver{"floods_after_the_end", std::string(kAsk) + "echo $$ >pid; exec yes >&3", 3, "extra: "}),
    [](const auto& each) { return each.param.name; });

// In a suite, too, and the others are not held up by it.
TEST_F(BadDriversTape, OfASuiteLeaveNothing) {
  std::ofstream(dir / "suite.toml")
      << "timeout = 3\ntape = \"t\"\n"
         "[[test]]\nname = \"good\"\ncommand = '"
      << kAsk
      << "'\n"
         "[[test]]\nname = \"daemon\"\ncommand = '''"
      << kAsk
      << "setsid sh -c 'echo $$ >pid; exec sleep 1000' & until [ -s pid ]; do sleep 0.01; done'''\n"
         "[[test]]\nname = \"flood\"\ncommand = '"
      << kAsk << "exec yes'\n";
  const Ran ran = run({"test", "--suite", dir / "", "-j", "2", "--format", "tap"});
  EXPECT_EQ(ran.status, 1) << ran.out << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("ok 1 - good\nok 2 - daemon\nnot ok 3 - flood\n"));
  EXPECT_LT(ran.out.size(), 400'000U);
  EXPECT_THAT(ran.out, HasSubstr("bytes are left out here"));
  expect_gone();
}

}  // namespace
}  // namespace porttape::test
