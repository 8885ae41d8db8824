#include "tools/command_family.hpp"

#include <cerrno>
#include <chrono>
#include <cstdio>
#include <functional>
#include <sched.h>
#include <signal.h>
#include <string>
#include <sys/mount.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include <gtest/gtest.h>

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

// Forks a shell.
pid_t shell(const std::string& command) {
  const pid_t pid = ::fork();
  if (pid == 0) {
    ::execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
    ::_exit(127);
  }
  return pid;
}

bool comes_true(const std::function<bool()>& condition) {
  const auto until = std::chrono::steady_clock::now() + seconds(60);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > until) return false;
    std::this_thread::sleep_for(milliseconds(5));
  }
  return true;
}

bool lives(pid_t pid) { return ::kill(pid, 0) == 0; }

TEST(CommandFamily, ReadsAProcessWhoseNameHoldsParentheses) {
  ProcessState process;
  ASSERT_TRUE(parse_process_stat(
      "42 (a) S (b) R 7 42 42 0 -1 4194304 100 0 0 0 30 12 0 0 20 0 1 0 98765 1000 10 18446744073709551615",
      process));
  EXPECT_EQ(process.number, 42);
  EXPECT_EQ(process.name, "a) S (b");
  EXPECT_EQ(process.state, 'R');
  EXPECT_EQ(process.parent, 7);
  EXPECT_EQ(process.cpu_ticks, 42U);
  EXPECT_EQ(process.started, 98765U);
  EXPECT_FALSE(parse_process_stat("", process));
  EXPECT_FALSE(parse_process_stat("42 (cut", process));
}

TEST(CommandFamily, EndsOrphansAndSparesWhatWasThereBefore) {
  const pid_t before = shell("exec sleep 1000");
  {
    CommandFamily family;
    ASSERT_TRUE(family.adopt().has_value());
    const pid_t command = shell("(setsid sleep 1000 &); sleep 1000 & exit 0");
    ::waitpid(command, nullptr, 0);
    ASSERT_TRUE(comes_true([&] { return family.members().size() == 2; }));
    const CommandFamily::Ended done = family.end(seconds(20), seconds(20));
    EXPECT_EQ(done.ended.size(), 2U);
    EXPECT_TRUE(done.left.empty());
    EXPECT_TRUE(family.members().empty());
  }
  EXPECT_TRUE(lives(before));
  ::kill(before, SIGKILL);
  ::waitpid(before, nullptr, 0);
}

// Forks a program of which no process lives long: each has a child and leaves. The last one after a minute.
pid_t hopper() {
  const pid_t pid = ::fork();
  if (pid != 0) return pid;
  const auto until = std::chrono::steady_clock::now() + seconds(60);
  while (std::chrono::steady_clock::now() < until) {
    if (::fork() != 0) ::_exit(0);
  }
  ::_exit(0);
}

bool any_child_left() { return ::waitpid(-1, nullptr, WNOHANG) >= 0 || errno != ECHILD; }

TEST(CommandFamily, CatchesWhatForksAndLeavesOnAndOn) {
  for (int round = 0; round < 3; ++round) {
    CommandFamily family;
    ASSERT_TRUE(family.adopt().has_value());
    ::waitpid(hopper(), nullptr, 0);
    const CommandFamily::Ended done = family.end(seconds(20), seconds(20));
    EXPECT_TRUE(done.left.empty());
    EXPECT_FALSE(done.unseen);
    EXPECT_FALSE(done.ended.empty());
    EXPECT_FALSE(any_child_left());
  }
}

TEST(CommandFamily, WhatIsCaughtIsNoneOfTheOthers) {
  const pid_t before = shell("exec sleep 1000");
  CommandFamily family;
  ASSERT_TRUE(family.adopt().has_value());
  const pid_t spared = shell("exec sleep 1000");
  family.spare(spared);
  ::waitpid(hopper(), nullptr, 0);
  EXPECT_TRUE(family.end(seconds(20), seconds(20)).left.empty());
  for (const pid_t other : {before, spared}) {
    EXPECT_TRUE(lives(other));
    ::kill(other, SIGKILL);
    ::waitpid(other, nullptr, 0);
  }
  EXPECT_FALSE(any_child_left());
}

TEST(CommandFamily, ReadsTheNumbersOfAProcess) {
  EXPECT_EQ(numbers_of_process("Name:\tx\nNSpid:\t4711\t12\t1\nNSpgid:\t4711\n"),
            (std::vector<pid_t>{4711, 12, 1}));
  EXPECT_EQ(numbers_of_process("Name:\tx\nNSpid:\t7\n"), std::vector<pid_t>{7});
  EXPECT_TRUE(numbers_of_process("Name:\tx\n").empty());
}

// Runs it as the first process of a new PID namespace, whose /proc is the outer one's.
void expect_in_pid_namespace(const std::function<void()>& work) {
  const pid_t outer = ::fork();
  if (outer == 0) {
    if (::unshare(CLONE_NEWPID | CLONE_NEWNS) != 0 ||
        ::mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0)
      ::_exit(77);
    const pid_t first = ::fork();
    if (first == 0) {
      work();
      std::fflush(stdout);
      ::_exit(testing::Test::HasFailure() ? 1 : 0);
    }
    int status = 0;
    ::waitpid(first, &status, 0);
    ::_exit(WIFEXITED(status) ? WEXITSTATUS(status) : 2);
  }
  int status = 0;
  ::waitpid(outer, &status, 0);
  if (WIFEXITED(status) && WEXITSTATUS(status) == 77) GTEST_SKIP() << "needs CAP_SYS_ADMIN, for namespaces";
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
}

TEST(CommandFamily, AProcOfAnOuterNamespaceShowsWhatIsOursAndNobodyElseIsTouched) {
  expect_in_pid_namespace([] {
    ASSERT_EQ(::getpid(), 1);
    const pid_t before = shell("exec sleep 1000");
    CommandFamily family;
    ASSERT_TRUE(family.adopt().has_value());
    const pid_t command = shell("(setsid sleep 1000 &); sleep 1000 & exit 0");
    ::waitpid(command, nullptr, 0);
    ASSERT_TRUE(comes_true([&] { return family.members().size() == 2; }));
    for (const ProcessState& process : family.members()) {
      EXPECT_TRUE(lives(process.pid)) << "by our number";
      EXPECT_NE(process.number, process.pid);
    }
    const pid_t spared = shell("exec sleep 1000");
    family.spare(spared);
    EXPECT_EQ(family.members().size(), 2U);
    const CommandFamily::Ended done = family.end(seconds(20), seconds(20));
    EXPECT_EQ(done.ended.size(), 2U);
    EXPECT_TRUE(done.left.empty() && !done.unseen);
    EXPECT_TRUE(lives(before));
    EXPECT_TRUE(lives(spared));
  });
}

TEST(CommandFamily, WithoutAProcThatShowsUsNothingIsEndedAndThatIsTold) {
  expect_in_pid_namespace([] {
    ASSERT_EQ(::mount("none", "/proc", "tmpfs", 0, nullptr), 0);
    CommandFamily family;
    ASSERT_TRUE(family.adopt().has_value());
    const pid_t left = shell("exec sleep 1000");
    EXPECT_TRUE(family.members().empty());
    const CommandFamily::Ended done = family.end(seconds(20), seconds(20));
    EXPECT_TRUE(done.ended.empty() && done.left.empty());
    EXPECT_TRUE(done.unseen);
    EXPECT_TRUE(lives(left));
    ::kill(left, SIGKILL);
    ::waitpid(left, nullptr, 0);
    EXPECT_FALSE(family.end(seconds(20), seconds(20)).unseen);
    const pid_t spared = shell("exec sleep 1000");
    family.spare(spared);
    EXPECT_FALSE(family.end(seconds(20), seconds(20)).unseen) << "it is not known that there are others";
    EXPECT_TRUE(lives(spared));
  });
}

TEST(CommandFamily, KillsWhatDoesNotHeedSigterm) {
  CommandFamily family;
  ASSERT_TRUE(family.adopt().has_value());
  const pid_t command = shell("trap '' TERM; while :; do sleep 1000; done");
  // The trap is set once its sleep runs.
  ASSERT_TRUE(comes_true([&] {
    for (const ProcessState& process : family.members())
      if (process.name == "sleep") return true;
    return false;
  }));
  const CommandFamily::Ended done = family.end(milliseconds(50), seconds(20));
  EXPECT_TRUE(done.left.empty());
  EXPECT_FALSE(lives(command));
}

TEST(CommandFamily, WhatRunsOrIsStoppedIsAwakeWhatSleepsIsNot) {
  CommandFamily family;
  ASSERT_TRUE(family.adopt().has_value());
  const pid_t command = shell("exec sleep 1000");
  EXPECT_TRUE(comes_true([&] { return !family.awake(); }));
  ::kill(command, SIGSTOP);
  EXPECT_TRUE(comes_true([&] { return family.awake(); }));
  ::kill(command, SIGCONT);
  EXPECT_TRUE(comes_true([&] { return !family.awake(); }));
  shell("while :; do :; done");
  EXPECT_TRUE(comes_true([&] { return family.awake(); }));
  EXPECT_TRUE(family.awake());
  (void)family.end(seconds(20), seconds(20));
}

}  // namespace
}  // namespace porttape
