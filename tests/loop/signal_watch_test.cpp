#include "libport/loop/signal_watch.hpp"

#include <cerrno>
#include <csignal>
#include <cstddef>
#include <memory>
#include <sys/syscall.h>
#include <sys/time.h>
#include <system_error>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/descriptor_limit.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/refused_calls.hpp"

namespace porttape {
namespace {

TEST(SignalWatch, CallsBackFromTheLoopForEachSignal) {
  Loop loop;
  std::vector<int> came;
  SignalWatch watch(loop, [&came](int number) { came.push_back(number); });
  watch.add({SIGUSR1, SIGUSR2});
  std::raise(SIGUSR1);
  std::raise(SIGUSR2);
  EXPECT_TRUE(came.empty());
  run_until(loop, [&came] { return came.size() == 2; });
  EXPECT_EQ(came, (std::vector<int>{SIGUSR1, SIGUSR2}));
}

// As it sends a terminal's.
TEST(SignalWatch, TellsWhichTheKernelSent) {
  Loop loop;
  std::vector<bool> came;
  SignalWatch watch(loop, [&](int) { came.push_back(watch.from_terminal()); });
  watch.add({SIGALRM});
  std::raise(SIGALRM);
  run_until(loop, [&came] { return came.size() == 1; });
  const itimerval soon{{}, {0, 1000}};
  ASSERT_EQ(::setitimer(ITIMER_REAL, &soon, nullptr), 0);
  run_until(loop, [&came] { return came.size() == 2; });
  EXPECT_EQ(came, (std::vector<bool>{false, true}));
}

TEST(SignalWatch, ACallbackMayEndIt) {
  Loop loop;
  std::unique_ptr<SignalWatch> watch;
  int came = 0;
  watch = std::make_unique<SignalWatch>(loop, [&](int) {
    ++came;
    watch.reset();
  });
  watch->add({SIGUSR1});
  std::raise(SIGUSR1);
  std::raise(SIGUSR1);
  run_until(loop, [&came] { return came > 0; });
  EXPECT_EQ(came, 1);
}

TEST(SignalWatch, ASignalAfterItsEndDoesNotEndTheProgram) {
  {
    Loop loop;
    SignalWatch watch(loop, [](int) {});
    watch.add({SIGUSR1});
  }
  std::raise(SIGUSR1);
}

TEST(SignalWatch, AllThatCameBeforeTheLoopLooksAreToldInTheirOrder) {
  Loop loop;
  std::vector<int> came;
  SignalWatch watch(loop, [&came](int number) { came.push_back(number); });
  watch.add({SIGUSR1, SIGUSR2});
  std::vector<int> raised;
  for (int i = 0; i < 40; ++i) raised.push_back(i % 3 == 0 ? SIGUSR1 : SIGUSR2);
  for (const int number : raised) std::raise(number);
  run_until(loop, [&] { return came.size() == raised.size(); });
  EXPECT_EQ(came, raised);
}

TEST(SignalWatch, ASignalForWhichThereIsNoRoomIsLostAndLeavesErrnoAlone) {
  Loop loop;
  std::size_t came = 0;
  SignalWatch watch(loop, [&came](int) { ++came; });
  watch.add({SIGUSR1});
  constexpr std::size_t kMoreThanAPipeHolds = 70'000;
  for (std::size_t i = 0; i < kMoreThanAPipeHolds; ++i) {
    errno = ENOENT;
    std::raise(SIGUSR1);
    ASSERT_EQ(errno, ENOENT);
  }
  run_until(loop, [&came] { return came > 0; });
  while (loop.poll_one()) {
  }
  EXPECT_LT(came, kMoreThanAPipeHolds);
}

TEST(SignalWatch, AProgramWithoutDescriptorsIsToldThatItHasNoPipe) {
  PORTTAPE_SKIP_UNDER_SANITIZERS();
  Loop loop;
  const test::NoDescriptors none(unsanitized);
  try {
    const SignalWatch watch(loop, [](int) {});
    FAIL() << "there is a pipe";
  } catch (const std::system_error& error) {
    EXPECT_EQ(error.code(), std::errc::too_many_files_open);
  }
}

TEST(SignalWatch, ASignalThatCannotBeReadNowIsReadLater) {
  Loop loop;
  std::vector<int> came;
  SignalWatch watch(loop, [&came](int number) { came.push_back(number); });
  watch.add({SIGUSR1});
  std::raise(SIGUSR1);
  for (const int error : {EINTR, EAGAIN, 0}) {
    EXPECT_TRUE(test::while_refused({{SYS_read, error}}, [&] {
      for (int n = 0; n < 10; ++n) loop.poll_one();
    }));
    EXPECT_TRUE(came.empty());
  }
  run_until(loop, [&came] { return !came.empty(); });
  EXPECT_EQ(came, std::vector<int>{SIGUSR1});
}

}  // namespace
}  // namespace porttape
