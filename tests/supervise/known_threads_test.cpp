#include "libport/supervise/known_threads.hpp"

#include <cerrno>
#include <csignal>
#include <sys/eventfd.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

#include <gtest/gtest.h>

namespace porttape {
namespace {

UniqueFd some_fd() { return UniqueFd(::eventfd(0, EFD_CLOEXEC)); }

TEST(KnownThreads, TheLastOnesAreFound) {
  KnownThreads threads;
  EXPECT_EQ(threads.find(1), -1);
  const int first = threads.keep(1, some_fd());
  EXPECT_GE(first, 0);
  EXPECT_EQ(threads.find(1), first);
  for (pid_t thread = 2; thread <= 20; ++thread) threads.keep(thread, some_fd());
  EXPECT_EQ(threads.find(1), -1);
  EXPECT_GE(threads.find(20), 0);
}

TEST(KnownThreads, OneThatIsForgottenIsNotFound) {
  KnownThreads threads;
  threads.keep(1, some_fd());
  const int second = threads.keep(2, some_fd());
  threads.forget(1);
  EXPECT_EQ(threads.find(1), -1);
  EXPECT_EQ(threads.find(2), second);
}

TEST(KnownThreads, NothingIsGotByThatOfAnEndedProcess) {
  KnownThreads threads;
  const pid_t child = ::fork();
  if (child == 0) {
    ::pause();
    ::_exit(0);
  }
  UniqueFd opened = threads.open(child);
  ASSERT_TRUE(opened);
  const int known = threads.keep(child, std::move(opened));
  ::kill(child, SIGKILL);
  ASSERT_EQ(::waitpid(child, nullptr, 0), child);
  EXPECT_EQ(::syscall(SYS_pidfd_getfd, known, 0, 0), -1);
  EXPECT_EQ(errno, ESRCH);
  EXPECT_FALSE(threads.open(child));
}

}  // namespace
}  // namespace porttape
