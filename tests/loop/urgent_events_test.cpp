#include "libport/loop/urgent_events.hpp"

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstddef>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <optional>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <set>
#include <string>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/descriptor_limit.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

// What an answer saw.
struct Seen {
  int fd = -1;
  ino_t file = 0;
  bool signals_are_blocked = false;
  int policy = -1;
};

std::array<int, 2> seen_pipe{};  // an answer is a plain function, and so it knows no test

void answer(int fd) {
  Seen seen{.fd = fd, .policy = ::sched_getscheduler(0)};
  struct stat status {};
  if (::fstat(fd, &status) == 0) seen.file = status.st_ino;
  sigset_t blocked;
  ::pthread_sigmask(SIG_BLOCK, nullptr, &blocked);
  seen.signals_are_blocked = ::sigismember(&blocked, SIGTERM) == 1 && ::sigismember(&blocked, SIGUSR1) == 1;
  (void)!::write(seen_pipe[1], &seen, sizeof seen);
}

std::ptrdiff_t threads() { return std::distance(std::filesystem::directory_iterator("/proc/self/task"), {}); }

// A thread that has been joined may be shown for a moment more.
bool come_to(std::ptrdiff_t count) {
  const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (threads() != count && std::chrono::steady_clock::now() < limit) ::sched_yield();
  return threads() == count;
}

ino_t file_of(const UniqueFd& fd) {
  struct stat status {};
  return ::fstat(fd.get(), &status) == 0 ? status.st_ino : 0;
}

struct Line {
  Line() {
    std::array<int, 2> ends{};
    if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) return;
    own.reset(ends[0]);
    peer.reset(ends[1]);
  }
  UniqueFd own;
  UniqueFd peer;
};

class UrgentEventsTest : public testing::Test {
 protected:
  void SetUp() override { ASSERT_EQ(::pipe2(seen_pipe.data(), O_CLOEXEC), 0); }
  void TearDown() override {
    for (const int end : seen_pipe) ::close(end);
  }
  // The next answer; nullopt where none comes within `limit` milliseconds.
  static std::optional<Seen> next(int limit = 60'000) {
    pollfd ready{seen_pipe[0], POLLIN, 0};
    Seen seen;
    if (::poll(&ready, 1, limit) != 1) return std::nullopt;
    return ::read(seen_pipe[0], &seen, sizeof seen) == sizeof seen ? std::optional(seen) : std::nullopt;
  }

  UrgentEvents events;
  Line one;
  Line other;
};

TEST_F(UrgentEventsTest, AHangUpIsAnsweredOnce) {
  auto watch = events.watch(one.own.get(), answer);
  ASSERT_TRUE(watch);
  one.peer.reset();
  EXPECT_TRUE(next());
  watch.reset();
  EXPECT_FALSE(next(0));
}

TEST_F(UrgentEventsTest, WhatCanBeReadIsNotUrgent) {
  auto watch = events.watch(one.own.get(), answer);
  ASSERT_EQ(::write(one.peer.get(), "x", 1), 1);
  const auto urgent = events.watch(other.own.get(), answer);
  other.peer.reset();
  const auto seen = next();
  ASSERT_TRUE(seen);
  EXPECT_EQ(seen->file, file_of(other.own));
  watch.reset();
  EXPECT_FALSE(next(0));
}

TEST_F(UrgentEventsTest, TheAnswerGetsADuplicateOfTheDescriptor) {
  const auto watch = events.watch(one.own.get(), answer);
  one.peer.reset();
  const auto seen = next();
  ASSERT_TRUE(seen);
  EXPECT_NE(seen->fd, one.own.get());
  EXPECT_EQ(seen->file, file_of(one.own));
  EXPECT_NE(::fcntl(seen->fd, F_GETFD) & FD_CLOEXEC, 0);
}

TEST_F(UrgentEventsTest, TheCallersDescriptorMayBeClosed) {
  const auto watch = events.watch(one.own.get(), answer);
  const ino_t file = file_of(one.own);
  one.own.reset();
  one.peer.reset();
  const auto seen = next();
  ASSERT_TRUE(seen);
  EXPECT_EQ(seen->file, file);
}

TEST_F(UrgentEventsTest, EachDescriptorHasItsOwnEvents) {
  const auto watch_of_one = events.watch(one.own.get(), answer);
  const auto watch_of_other = events.watch(other.own.get(), answer);
  other.peer.reset();
  const auto first = next();
  ASSERT_TRUE(first);
  EXPECT_EQ(first->file, file_of(other.own));
  one.peer.reset();
  const auto second = next();
  ASSERT_TRUE(second);
  EXPECT_EQ(second->file, file_of(one.own));
}

TEST_F(UrgentEventsTest, TheEndOfAWatchIsTheEndOfItsDuplicate) {
  auto watch_of_one = events.watch(one.own.get(), answer);
  const auto watch_of_other = events.watch(other.own.get(), answer);
  one.own.reset();
  watch_of_one.reset();
  pollfd hung_up{one.peer.get(), 0, 0};
  EXPECT_EQ(::poll(&hung_up, 1, 60'000), 1) << "nobody has the other end";
  other.peer.reset();
  const auto seen = next();
  ASSERT_TRUE(seen) << "the other watch goes on";
  EXPECT_EQ(seen->file, file_of(other.own));
}

TEST_F(UrgentEventsTest, TheThreadIsThereWhileAnythingIsWatched) {
  const auto before = threads();
  auto watch_of_one = events.watch(one.own.get(), answer);
  auto watch_of_other = events.watch(other.own.get(), answer);
  EXPECT_EQ(threads(), before + 1) << "one for all";
  watch_of_one.reset();
  EXPECT_EQ(threads(), before + 1);
  watch_of_other.reset();
  EXPECT_TRUE(come_to(before));
}

TEST_F(UrgentEventsTest, AfterTheLastWatchThereMayBeAnother) {
  (void)events.watch(one.own.get(), answer);
  const auto watch = events.watch(other.own.get(), answer);
  ASSERT_TRUE(watch);
  other.peer.reset();
  EXPECT_TRUE(next());
}

TEST_F(UrgentEventsTest, NoSignalIsTheThreads) {
  const auto watch = events.watch(one.own.get(), answer);
  one.peer.reset();
  const auto seen = next();
  ASSERT_TRUE(seen);
  EXPECT_TRUE(seen->signals_are_blocked);
}

TEST_F(UrgentEventsTest, TheSignalsOfTheCallerAreAsTheyWere) {
  sigset_t some;
  ::sigemptyset(&some);
  ::sigaddset(&some, SIGUSR2);
  sigset_t before;
  ASSERT_EQ(::pthread_sigmask(SIG_BLOCK, &some, &before), 0);
  const auto watch = events.watch(one.own.get(), answer);
  sigset_t after;
  ASSERT_EQ(::pthread_sigmask(SIG_SETMASK, &before, &after), 0);
  EXPECT_EQ(::sigismember(&after, SIGUSR2), 1);
  EXPECT_EQ(::sigismember(&after, SIGTERM), 0);
}

TEST_F(UrgentEventsTest, TheThreadHasRealTimePriorityWhereThatIsPermitted) {
  int permitted = SCHED_OTHER;
  std::thread([&permitted] {
    const sched_param priority{.sched_priority = 1};
    if (::sched_setscheduler(0, SCHED_FIFO, &priority) == 0) permitted = SCHED_FIFO;
  }).join();
  const auto watch = events.watch(one.own.get(), answer);
  one.peer.reset();
  const auto seen = next();
  ASSERT_TRUE(seen);
  EXPECT_EQ(seen->policy, permitted);
}

TEST_F(UrgentEventsTest, WhatCannotBeWatchedIsNot) {
  EXPECT_FALSE(events.watch(-1, answer));
  const test::TempDir dir;
  const UniqueFd file(::open((dir / "file").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600));
  ASSERT_TRUE(file);
  EXPECT_FALSE(events.watch(file.get(), answer)) << "a file has no events";
}

TEST_F(UrgentEventsTest, WithoutDescriptorsNothingIsWatchedUntilThereAreSome) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  for (const std::size_t left : {0U, 1U, 2U}) {
    UrgentEvents own;
    {
      const test::FewDescriptors few(unsanitized, left);
      EXPECT_FALSE(own.watch(one.own.get(), answer)) << left;
    }
    EXPECT_TRUE(own.watch(one.own.get(), answer)) << left;
  }
}

TEST_F(UrgentEventsTest, WhereACallFailsNothingIsWatchedUntilItSucceeds) {
  const std::vector<test::RefusedCall> cases[] = {
      {{SYS_epoll_create1, EMFILE}},
      {{SYS_eventfd2, ENFILE}},
      {{SYS_epoll_ctl, ENOSPC}},
      {{SYS_fcntl, EMFILE, test::RefusedCall::Argument{1, 0xffffffff, F_DUPFD_CLOEXEC}}},
#ifdef SYS_clone3
      {{SYS_clone3, EAGAIN}, {SYS_clone, EAGAIN}},
#endif
  };
  for (const auto& calls : cases) {
    UrgentEvents own;
    Line line;
    sigset_t mask;
    EXPECT_TRUE(test::while_refused(calls, [&] {
      EXPECT_FALSE(own.watch(line.own.get(), answer));
      ::pthread_sigmask(SIG_BLOCK, nullptr, &mask);
    }));
    EXPECT_EQ(::sigismember(&mask, SIGTERM), 0) << "the caller's signals are as they were";
    const auto watch = own.watch(line.own.get(), answer);
    ASSERT_TRUE(watch);
    line.peer.reset();
    EXPECT_TRUE(next());
  }
}

TEST_F(UrgentEventsTest, WithoutARightToRealTimeItIsAnsweredAllTheSame) {
  std::unique_ptr<UrgentEvents::Watch> watch;
  EXPECT_TRUE(test::while_refused({{SYS_sched_setscheduler, EPERM}},
                                  [&] { watch = events.watch(one.own.get(), answer); }));
  one.peer.reset();
  const auto seen = next();
  ASSERT_TRUE(seen);
  EXPECT_EQ(seen->policy, SCHED_OTHER);
}

#ifdef SYS_epoll_wait
TEST_F(UrgentEventsTest, AThreadThatCannotWaitEndsAndKeepsNobody) {
  const auto before = threads();
  std::unique_ptr<UrgentEvents::Watch> watch;
  EXPECT_TRUE(test::while_refused({{SYS_epoll_wait, EBADF}, {SYS_epoll_pwait, EBADF}},
                                  [&] { watch = events.watch(one.own.get(), answer); }));
  ASSERT_TRUE(watch);
  EXPECT_TRUE(come_to(before));
  watch.reset();
  watch = events.watch(other.own.get(), answer);
  other.peer.reset();
  EXPECT_TRUE(next()) << "a new thread";
}
#endif

// The letter by which the kernel shows what a thread does: S, it sleeps.
char state_of(const std::string& thread) {
  std::ifstream file("/proc/self/task/" + thread + "/stat");
  std::string text;
  std::getline(file, text);
  const std::size_t name_ends = text.rfind(')');
  return name_ends + 2 < text.size() ? text[name_ends + 2] : '?';
}

TEST_F(UrgentEventsTest, WhileNothingHappensTheThreadSleeps) {
  std::set<std::string> before;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/task"))
    before.insert(entry.path().filename());
  const auto watch = events.watch(one.own.get(), answer);
  one.peer.reset();
  ASSERT_TRUE(next()) << "it has begun";
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/task")) {
    const std::string thread = entry.path().filename();
    if (before.contains(thread)) continue;
    const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (state_of(thread) != 'S' && std::chrono::steady_clock::now() < limit) ::sched_yield();
    EXPECT_EQ(state_of(thread), 'S');
  }
}

}  // namespace
}  // namespace porttape
