// Real programs, looked at.

#include "libport/supervise/probe_calls.hpp"

#include <algorithm>
#include <fcntl.h>
#include <memory>
#include <optional>
#include <stdlib.h>
#include <string>
#include <sys/wait.h>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "libport/supervise/supervised_command.hpp"

namespace porttape {
namespace {

using Effect = ProbeFindings::Effect;

class ProbeCallsTest : public testing::Test {
 public:
  int run(std::vector<std::string> command) {
    Loop loop;
    std::vector<std::unique_ptr<CallPart>> parts;
    parts.push_back(std::make_unique<ProbeCalls>(findings, loop.clock()));
    std::optional<int> status;
    SupervisedCommand::Trouble trouble;
    const auto running = SupervisedCommand::start(
        loop,
        {.command = std::move(command),
         .environment = {"PATH=/usr/bin:/bin"},
         .output_to_stderr = true,
         .traps = Supervisor::traps(parts)},
        [&](int wait_status) { status = wait_status; }, trouble);
    if (!running) return -1;
    const Supervisor supervisor(loop, running->take_listener(), std::move(parts));
    while (!status) loop.run_one();
    return WEXITSTATUS(*status);
  }
  const ProbeFindings::Row* row(const std::string& call) const {
    const auto found = std::ranges::find(findings.rows, call, &ProbeFindings::Row::call);
    return found == findings.rows.end() ? nullptr : &*found;
  }

  ProbeFindings findings;
};

TEST_F(ProbeCallsTest, ParityIsSeenAndLeftToTheKernel) {
  const UniqueFd master(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC));
  ASSERT_EQ(::grantpt(master.get()), 0);
  ASSERT_EQ(::unlockpt(master.get()), 0);
  const std::string path = ::ptsname(master.get());
  EXPECT_EQ(run({"stty", "-F", path, "parenb"}), 1);  // it reads back what it has set
  ASSERT_NE(row("parity"), nullptr);
  EXPECT_EQ(row("parity")->effect, Effect::bends);
  ASSERT_EQ(findings.ports.size(), 1U);
  EXPECT_EQ(findings.ports.front().name, path);
  EXPECT_TRUE(findings.ports.front().pty);
}

TEST_F(ProbeCallsTest, NamesOfDevicesAreCounted) {
  EXPECT_EQ(run({"sh", "-c", "test -e /dev/ttyUSB77; test -e /dev/ttyUSB77; test -e /dev/ttyUSB"}), 1);
  ASSERT_NE(row("names /dev/ttyUSB77"), nullptr);
  EXPECT_EQ(row("names /dev/ttyUSB77")->count, 2U);
  EXPECT_EQ(findings.names, std::vector<std::string>{"/dev/ttyUSB77"});
  EXPECT_TRUE(findings.any(Effect::finds));
}

TEST_F(ProbeCallsTest, ManyNamesAreOneRow) {
  EXPECT_EQ(run({"sh", "-c", "for n in 0 1 2 3 4 5 6 7 8 9; do test -e /dev/ttyUSB9$n; done; true"}), 0);
  ASSERT_NE(row("names more ports"), nullptr);
  EXPECT_EQ(row("names more ports")->count, 2U);
  EXPECT_EQ(findings.names.size(), 8U);
}

TEST_F(ProbeCallsTest, WhatIsNoPortIsNotTold) {
  EXPECT_EQ(run({"sh", "-c", "stty -F /dev/null parenb; test -e /dev/null"}), 0);
  EXPECT_TRUE(findings.ports.empty());
  EXPECT_FALSE(findings.any(Effect::bends));
}

}  // namespace
}  // namespace porttape
