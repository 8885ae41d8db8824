#include "libport/loop/signal_watch.hpp"

#include <csignal>
#include <memory>
#include <sys/time.h>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/port_log.hpp"

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

}  // namespace
}  // namespace porttape
