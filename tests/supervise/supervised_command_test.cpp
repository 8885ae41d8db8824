// The command, its guard, and who ends whom.

#include "libport/supervise/supervised_command.hpp"

#include <cerrno>
#include <fcntl.h>
#include <fstream>
#include <memory>
#include <optional>
#include <signal.h>
#include <string>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/supervise/supervisor.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using Stage = SupervisedCommand::Trouble::Stage;
using testing::HasSubstr;

class SupervisedCommandTest : public testing::Test {
 public:
  std::unique_ptr<SupervisedCommand> start(std::vector<std::string> command,
                                           std::function<Result<void>()> prepare = {}) {
    return SupervisedCommand::start(
        loop,
        {.command = std::move(command),
         .environment = {"PATH=/usr/bin:/bin", "MARK=here"},
         .traps = {{.number = SYS_ioctl, .requests = {0x5415}}},
         .prepare = std::move(prepare)},
        [this](int wait_status) { status = wait_status; }, trouble);
  }
  int run(std::vector<std::string> command) {
    const auto running = start(std::move(command));
    if (!running) return -1;
    while (!status) loop.run_one();
    return *status;
  }

  Loop loop;
  test::TempDir dir;
  std::optional<int> status;
  SupervisedCommand::Trouble trouble;
};

pid_t number_in(const std::string& path) {
  pid_t number = 0;
  while (number == 0) {
    std::ifstream file(path);
    file >> number;
  }
  return number;
}

TEST_F(SupervisedCommandTest, ItsEndIsTold) {
  EXPECT_EQ(WEXITSTATUS(run({"sh", "-c", "test $MARK = here && exit 5"})), 5);
}

TEST_F(SupervisedCommandTest, ItsSignalIsTold) {
  EXPECT_EQ(WTERMSIG(run({"sh", "-c", "kill -9 $$"})), SIGKILL);
}

TEST_F(SupervisedCommandTest, ACommandThatIsNotThereIsToldAtOnce) {
  EXPECT_EQ(start({"/no/such/command"}), nullptr);
  EXPECT_EQ(trouble.stage, Stage::exec);
  EXPECT_EQ(trouble.error, ENOENT);
}

TEST_F(SupervisedCommandTest, WhatPrepareSaysIsTold) {
  EXPECT_EQ(start({"true"}, [] { return make_error(Errc::usage, "not here"); }), nullptr);
  EXPECT_EQ(trouble.stage, Stage::prepare);
  EXPECT_EQ(trouble.message, "not here");
}

TEST_F(SupervisedCommandTest, ASecondSupervisorIsRefusedInWords) {
  EXPECT_EQ(start({"true"},
                  [] {
                    Result<UniqueFd> other = trap_calls({{.number = SYS_getsid}});
                    (void)other->release();  // whose supervisor lives
                    return Result<void>();
                  }),
            nullptr);
  EXPECT_EQ(trouble.stage, Stage::trap);
  EXPECT_THAT(trouble.message, HasSubstr("supervised already"));
}

TEST_F(SupervisedCommandTest, WhatItLeftRunningEndsWithUs) {
  // One whose parent has gone and that has a session of its own.
  auto running =
      start({"sh", "-c", "setsid sh -c 'echo $$ >" + (dir / "pid") + "; exec sleep 1000' & sleep 1000"});
  ASSERT_NE(running, nullptr);
  const pid_t left = number_in(dir / "pid");
  const pid_t command = running->command();
  running.reset();
  EXPECT_EQ(::kill(left, 0), -1);
  EXPECT_EQ(::kill(command, 0), -1);
}

TEST_F(SupervisedCommandTest, ItInheritsAllButWhatIsOurs) {
  const UniqueFd inherited(::open("/dev/null", O_RDONLY));
  const UniqueFd ours(::open("/dev/null", O_RDONLY | O_CLOEXEC));
  const std::string folder = "/proc/self/fd/";
  EXPECT_EQ(WEXITSTATUS(run({"sh", "-c",
                             "test -e " + folder + std::to_string(inherited.get()) + " && ! test -e " +
                                 folder + std::to_string(ours.get()) + " && exit 5"})),
            5);
}

// Else its calls fail with ENOSYS once we are killed, too.
TEST_F(SupervisedCommandTest, AKilledGuardTakesTheCommandWithIt) {
  int was_adopting = 0;
  ASSERT_EQ(::prctl(PR_GET_CHILD_SUBREAPER, &was_adopting, 0, 0, 0), 0);
  ASSERT_EQ(::prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0), 0);
  const auto running = start({"sh", "-c", "echo $$ >" + (dir / "pid") + "; exec sleep 1000"});
  ASSERT_NE(running, nullptr);
  (void)number_in(dir / "pid");
  ::kill(running->guard(), SIGKILL);
  while (!status) loop.run_one();
  EXPECT_TRUE(WIFSIGNALED(*status) && WTERMSIG(*status) == SIGKILL) << *status;
  EXPECT_FALSE(running->running());
  ::prctl(PR_SET_CHILD_SUBREAPER, was_adopting, 0, 0, 0);
}

}  // namespace
}  // namespace porttape
