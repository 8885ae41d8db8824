// What the guard and the command tell each other, and a guard to which the system refuses something.

#include "libport/supervise/guard.hpp"

#include <array>
#include <cerrno>
#include <csignal>
#include <fcntl.h>
#include <fstream>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <sys/eventfd.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/loop/fd_watch.hpp"
#include "libport/supervise/supervised_command.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using Stage = SupervisedCommand::Trouble::Stage;
using Kind = GuardMessage::Kind;
using test::holds_without;
using test::RefusedCall;

struct Line {
  Line() {
    std::array<int, 2> pair{};
    if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair.data()) != 0) std::abort();
    near.reset(pair[0]);
    far.reset(pair[1]);
  }
  UniqueFd near;
  UniqueFd far;
};

TEST(GuardMessages, AMessageComesAsItWasSent) {
  const Line line;
  for (const GuardMessage& sent : {GuardMessage{Kind::trouble, Stage::exec, ENOENT, "no such command"},
                                   GuardMessage{Kind::exited, Stage::machinery, 0x500, ""},
                                   GuardMessage{Kind::running, Stage::prepare, 77, "x"}}) {
    ASSERT_TRUE(send_message(line.near.get(), sent));
    UniqueFd fd;
    const std::optional<GuardMessage> got = receive_message(line.far.get(), fd);
    ASSERT_TRUE(got.has_value());
    EXPECT_EQ(got->kind, sent.kind);
    EXPECT_EQ(got->stage, sent.stage);
    EXPECT_EQ(got->number, sent.number);
    EXPECT_EQ(got->text, sent.text);
    EXPECT_FALSE(fd) << "none was sent";
  }
}

TEST(GuardMessages, AFileComesWithIt) {
  const Line line;
  const UniqueFd file(::open("/dev/null", O_RDONLY | O_CLOEXEC));
  ASSERT_TRUE(send_message(line.near.get(), {Kind::started, {}, 5, {}}, file.get()));
  UniqueFd fd;
  ASSERT_TRUE(receive_message(line.far.get(), fd).has_value());
  ASSERT_TRUE(fd);
  EXPECT_NE(fd.get(), file.get());
  EXPECT_EQ(::fcntl(fd.get(), F_GETFD), FD_CLOEXEC) << "no command inherits it";
  struct stat one {};
  struct stat other {};
  ASSERT_EQ(::fstat(file.get(), &one), 0);
  ASSERT_EQ(::fstat(fd.get(), &other), 0);
  EXPECT_EQ(one.st_rdev, other.st_rdev);
}

TEST(GuardMessages, ALongTextIsCut) {
  const Line line;
  ASSERT_TRUE(send_message(line.near.get(), {Kind::trouble, {}, 0, std::string(3000, 'x')}));
  UniqueFd fd;
  const std::optional<GuardMessage> got = receive_message(line.far.get(), fd);
  ASSERT_TRUE(got.has_value());
  EXPECT_EQ(got->text, std::string(2048, 'x'));
}

TEST(GuardMessages, WhatIsNoMessageIsNone) {
  Line line;
  UniqueFd fd;
  ASSERT_EQ(::send(line.near.get(), "abc", 3, 0), 3);
  EXPECT_FALSE(receive_message(line.far.get(), fd).has_value());
  line.near.reset();
  EXPECT_FALSE(receive_message(line.far.get(), fd).has_value());
  EXPECT_FALSE(send_message(line.far.get(), {})) << "and no SIGPIPE ends the guard";
}

class GuardTest : public testing::Test {
 protected:
  // What keeps the command from running, where these calls are refused to us, and those to the guard.
  testing::AssertionResult without(const std::vector<RefusedCall>& ours,
                                   const std::vector<RefusedCall>& guards,
                                   const SupervisedCommand::Trouble& expected, bool to_stderr = false) {
    return holds_without(ours, [&] {
      Loop loop;
      SupervisedCommand::Trouble trouble;
      SupervisedCommand::Options options = options_for({"true"});
      options.output_to_stderr = to_stderr;
      options.prepare = [&]() -> Result<void> {
        if (!guards.empty() && !test::refuse(guards)) return make_error(Errc::usage, "not refused");
        return {};
      };
      EXPECT_EQ(SupervisedCommand::start(
                    loop, options, [](int) {}, trouble),
                nullptr);
      EXPECT_EQ(trouble.stage, expected.stage);
      EXPECT_EQ(trouble.error, expected.error);
      EXPECT_THAT(trouble.message, testing::StartsWith(expected.message));
      EXPECT_EQ(trouble.message.empty(), expected.message.empty());
      EXPECT_EQ(::waitpid(-1, nullptr, 0), -1) << "a guard is left";
    });
  }
  static SupervisedCommand::Options options_for(std::vector<std::string> command) {
    return {.command = std::move(command),
            .environment = {"PATH=/usr/bin:/bin"},
            .traps = {{.number = SYS_ioctl, .requests = {0x5415}}}};
  }
  int run(const SupervisedCommand::Options& options) {
    Loop loop;
    SupervisedCommand::Trouble trouble;
    std::optional<int> status;
    const auto running = SupervisedCommand::start(
        loop, options, [&](int wait_status) { status = wait_status; }, trouble);
    if (!running) {
      ADD_FAILURE() << trouble.message;
      return -1;
    }
    while (!status) loop.run_one();
    EXPECT_FALSE(running->running());
    return *status;
  }
};

TEST_F(GuardTest, WhatTheSystemRefusesIsNamed) {
  EXPECT_TRUE(without({{SYS_socketpair, EMFILE}}, {}, {Stage::machinery, EMFILE, "a socket for the guard"}));
  EXPECT_TRUE(without({{SYS_clone, EAGAIN}}, {}, {Stage::machinery, EAGAIN, "a process for the guard"}));
  EXPECT_TRUE(without({{SYS_signalfd4, ENFILE}}, {}, {Stage::machinery, ENFILE, "a socket for the command"}));
  EXPECT_TRUE(without({}, {{SYS_clone, EAGAIN}}, {Stage::machinery, EAGAIN, "a process for the command"}));
  EXPECT_TRUE(without({}, {{SYS_seccomp, EPERM}}, {Stage::trap, 0, "seccomp is refused here"}));
  EXPECT_TRUE(without({}, {{SYS_execve, EACCES}}, {Stage::exec, EACCES, ""}));
}

#ifdef SYS_dup2
TEST_F(GuardTest, AnOutputThatCannotBeTurnedIsNamed) {
  EXPECT_TRUE(without({}, {{SYS_dup2, EBUSY}}, {Stage::machinery, EBUSY, "the command's stdout"}, true));
}
#endif

TEST_F(GuardTest, AGuardThatEndsBeforeTheCommandIsTold) {
  EXPECT_TRUE(holds_without({}, [&] {
    Loop loop;
    SupervisedCommand::Trouble trouble;
    SupervisedCommand::Options options = options_for({"true"});
    options.prepare = []() -> Result<void> { ::_exit(0); };
    EXPECT_EQ(SupervisedCommand::start(
                  loop, options, [](int) {}, trouble),
              nullptr);
    EXPECT_EQ(trouble.stage, Stage::machinery);
    EXPECT_EQ(trouble.error, 0) << "nothing of the system has failed";
    EXPECT_EQ(trouble.message, "the guard of the command has ended");
  }));
}

TEST_F(GuardTest, TheOutputGoesWhereErrorsGo) {
  const test::TempDir dir;
  EXPECT_TRUE(holds_without({}, [&] {
    const UniqueFd errors(::open((dir / "errors").c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
    const UniqueFd output(::open((dir / "output").c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
    ASSERT_GE(::dup2(errors.get(), STDERR_FILENO), 0);
    ASSERT_GE(::dup2(output.get(), STDOUT_FILENO), 0);
    SupervisedCommand::Options options = options_for({"sh", "-c", "echo said"});
    EXPECT_EQ(run(options), 0);
    options.output_to_stderr = true;
    EXPECT_EQ(run(options), 0);
  }));
  std::string text;
  std::getline(std::ifstream(dir / "errors"), text, '\0');
  EXPECT_EQ(text, "said\n");
  std::getline(std::ifstream(dir / "output"), text, '\0');
  EXPECT_EQ(text, "said\n");
}

// Those that we ignore stay ignored, as under a shell's nohup, unless only we have reason to.
TEST_F(GuardTest, TheCommandHasTheSignalsOfWhoCalledUs) {
  EXPECT_TRUE(holds_without({}, [&] {
    SupervisedCommand::Options options = options_for({"sh", "-c", "kill -USR1 $$; exit 5"});
    EXPECT_TRUE(WIFSIGNALED(run(options)));
    ::signal(SIGUSR1, SIG_IGN);
    EXPECT_EQ(WEXITSTATUS(run(options)), 5);
    options.default_signals = {SIGUSR2, SIGUSR1};
    EXPECT_EQ(WTERMSIG(run(options)), SIGUSR1);
    ::signal(SIGUSR1, [](int) {});
    options.default_signals = {};
    EXPECT_EQ(WTERMSIG(run(options)), SIGUSR1) << "a handler of ours is no business of the command";
    sigset_t blocked;
    ::sigemptyset(&blocked);
    ::sigaddset(&blocked, SIGUSR1);
    ::sigprocmask(SIG_BLOCK, &blocked, nullptr);
    EXPECT_EQ(WEXITSTATUS(run(options)), 5);
    sigset_t now;
    ::sigprocmask(SIG_SETMASK, nullptr, &now);
    EXPECT_EQ(::sigismember(&now, SIGUSR1), 1);
    EXPECT_EQ(::sigismember(&now, SIGUSR2), 0) << "start() leaves the mask as it was";
  }));
}

TEST_F(GuardTest, AKillReachesTheCommand) {
  Loop loop;
  SupervisedCommand::Trouble trouble;
  std::optional<int> status;
  const auto running = SupervisedCommand::start(
      loop, options_for({"sleep", "1000"}), [&](int wait_status) { status = wait_status; }, trouble);
  ASSERT_NE(running, nullptr);
  EXPECT_TRUE(running->running());
  running->kill(SIGTERM);
  while (!status) loop.run_one();
  EXPECT_EQ(WTERMSIG(*status), SIGTERM);
  EXPECT_FALSE(running->running());
  running->kill(SIGTERM);  // nobody
}

// The loop has two events. The first ends the watch of the second and starts a command, whose watch then gets
// the second one's event.
TEST_F(GuardTest, AnEventThatIsNotTheGuardsIsNotItsEnd) {
  Loop loop;
  const UniqueFd event(::eventfd(1, EFD_CLOEXEC | EFD_NONBLOCK));
  const UniqueFd other_event(::eventfd(1, EFD_CLOEXEC | EFD_NONBLOCK));
  std::unique_ptr<SupervisedCommand> running;
  SupervisedCommand::Trouble trouble;
  std::optional<int> status;
  std::unique_ptr<FdWatch> one;
  std::unique_ptr<FdWatch> other;
  const auto start = [&](FdWatch& watch, std::unique_ptr<FdWatch>& ended) {
    watch.watch_readable(false);
    ended.reset();
    running = SupervisedCommand::start(
        loop, options_for({"sleep", "1000"}), [&](int wait_status) { status = wait_status; }, trouble);
    loop.post([&] { loop.post([&] { running->kill(SIGTERM); }); });
  };
  one = std::make_unique<FdWatch>(loop, event.get(), [&] { start(*one, other); });
  other = std::make_unique<FdWatch>(loop, other_event.get(), [&] { start(*other, one); });
  one->watch_readable(true);
  other->watch_readable(true);
  while (!status) loop.run_one();
  EXPECT_NE(running->guard(), 0);
  EXPECT_TRUE(WIFSIGNALED(*status) && WTERMSIG(*status) == SIGTERM) << *status;
}

// Where orphans do not fall to us, its status is not ours to read. It has ended with the guard.
TEST_F(GuardTest, AnOrphanThatFallsToAnotherWasKilled) {
  ASSERT_EQ(::prctl(PR_SET_CHILD_SUBREAPER, 0, 0, 0, 0), 0);
  Loop loop;
  SupervisedCommand::Trouble trouble;
  std::optional<int> status;
  const auto running = SupervisedCommand::start(
      loop, options_for({"sleep", "1000"}), [&](int wait_status) { status = wait_status; }, trouble);
  ASSERT_NE(running, nullptr);
  ::kill(running->guard(), SIGKILL);
  while (!status) loop.run_one();
  EXPECT_TRUE(WIFSIGNALED(*status) && WTERMSIG(*status) == SIGKILL) << *status;
  EXPECT_EQ(running->guard(), 0);
}

}  // namespace
}  // namespace porttape
