#include "tools/command_family.hpp"

#include <chrono>
#include <functional>
#include <signal.h>
#include <string>
#include <sys/types.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

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
  EXPECT_EQ(process.pid, 42);
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
