// What the kernel tells of threads that wait, are stopped, or have ended.

#include "libport/supervise/pending_signals.hpp"

#include <array>
#include <atomic>
#include <csignal>
#include <fcntl.h>
#include <functional>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"

namespace porttape {
namespace {

constexpr std::uint64_t bit_of(int number) { return std::uint64_t{1} << static_cast<unsigned>(number - 1); }

// A child that blocks SIGUSR1 and SIGTERM, ignores SIGUSR2, and waits.
class Child {
 public:
  Child() {
    std::array<int, 2> pair{};
    if (::pipe2(pair.data(), O_CLOEXEC) != 0) std::abort();
    const UniqueFd from(pair[0]);
    UniqueFd to(pair[1]);
    pid = ::fork();
    if (pid == 0) {
      sigset_t blocked;
      ::sigemptyset(&blocked);
      ::sigaddset(&blocked, SIGUSR1);
      ::sigaddset(&blocked, SIGTERM);
      ::sigaddset(&blocked, SIGUSR2);
      ::sigprocmask(SIG_SETMASK, &blocked, nullptr);
      ::signal(SIGUSR2, SIG_IGN);
      (void)!::write(to.get(), "x", 1);
      for (;;) ::pause();
    }
    to.reset();
    char done = 0;
    (void)!::read(from.get(), &done, 1);
  }
  ~Child() {
    if (pid <= 0) return;
    ::kill(pid, SIGKILL);
    ::waitpid(pid, nullptr, 0);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  pid_t pid = -1;
};

TEST(PendingSignals, OfAThreadAndOfItsProcessAreToldApart) {
  const Child child;
  const ThreadStatus before = thread_status(child.pid);
  EXPECT_EQ(before.to_thread, 0U);
  EXPECT_EQ(before.to_process, 0U);
  EXPECT_EQ(before.blocked, bit_of(SIGUSR1) | bit_of(SIGTERM) | bit_of(SIGUSR2));
  ASSERT_EQ(::syscall(SYS_tgkill, child.pid, child.pid, SIGUSR1), 0);
  ASSERT_EQ(::kill(child.pid, SIGTERM), 0);
  const ThreadStatus status = thread_status(child.pid);
  EXPECT_EQ(status.to_thread, bit_of(SIGUSR1));
  EXPECT_EQ(status.to_process, bit_of(SIGTERM));
  EXPECT_GE(status.queued, 2U);
}

// The kernel keeps a signal that is blocked, although it is ignored.
TEST(PendingSignals, ThoseThatAreIgnoredDoNotCount) {
  const Child child;
  ASSERT_EQ(::kill(child.pid, SIGUSR2), 0);
  ASSERT_EQ(::syscall(SYS_tgkill, child.pid, child.pid, SIGUSR2), 0);
  const ThreadStatus status = thread_status(child.pid);
  EXPECT_EQ(status.to_process, 0U);
  EXPECT_EQ(status.to_thread, 0U);
}

TEST(PendingSignals, AThreadIsOfItsProcess) {
  const Child child;
  const ThreadStatus status = thread_status(child.pid);
  EXPECT_TRUE(status.exists());
  EXPECT_TRUE(status.takes_signals());
  EXPECT_EQ(status.process, child.pid);
  EXPECT_EQ(status.threads, 1U);
  EXPECT_EQ(status.tracer, 0);
  pid_t of_thread = 0;
  unsigned threads = 0;
  std::thread([&] {
    of_thread = process_of(::gettid());
    threads = thread_status(::gettid()).threads;
  }).join();
  EXPECT_EQ(of_thread, ::getpid());
  EXPECT_GE(threads, 2U);
}

TEST(PendingSignals, AStoppedOneAndAnEndedOneAreKnown) {
  Child child;
  ASSERT_EQ(::kill(child.pid, SIGSTOP), 0);
  int status = 0;
  ASSERT_EQ(::waitpid(child.pid, &status, WUNTRACED), child.pid);
  EXPECT_EQ(thread_status(child.pid).state, 'T');
  EXPECT_TRUE(thread_status(child.pid).takes_signals());
  ASSERT_EQ(::kill(child.pid, SIGKILL), 0);
  siginfo_t ended{};
  ASSERT_EQ(::waitid(P_PID, static_cast<id_t>(child.pid), &ended, WEXITED | WNOWAIT), 0);
  EXPECT_EQ(thread_status(child.pid).state, 'Z');
  EXPECT_TRUE(thread_status(child.pid).exists());
  EXPECT_FALSE(thread_status(child.pid).takes_signals());
  ASSERT_EQ(::waitpid(child.pid, nullptr, 0), child.pid);
  EXPECT_FALSE(thread_status(child.pid).exists());
  EXPECT_FALSE(thread_status(child.pid).takes_signals());
  EXPECT_EQ(process_of(child.pid), 0);
  EXPECT_FALSE(have_signals_looked_for(child.pid));
  child.pid = -1;
}

TEST(PendingSignals, ATracerIsNamedAndAnotherOneRefused) {
  const Child child;
  pid_t tracer = 0;
  bool seized = false;
  ThreadStatus traced;
  bool looked_for = true;
  std::thread([&] {
    tracer = ::gettid();
    seized = ::ptrace(PTRACE_SEIZE, child.pid, nullptr, nullptr) == 0;
    traced = thread_status(child.pid);
    looked_for = have_signals_looked_for(child.pid);
  }).join();
  if (!seized) GTEST_SKIP() << "tracing is forbidden here";
  EXPECT_EQ(traced.tracer, tracer);
  EXPECT_FALSE(looked_for);
  EXPECT_TRUE(have_signals_looked_for(child.pid)) << "its tracer has ended";
  EXPECT_EQ(thread_status(child.pid).tracer, 0);
}

}  // namespace
}  // namespace porttape
