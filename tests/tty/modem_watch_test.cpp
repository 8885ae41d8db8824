#include "libport/tty/modem_watch.hpp"

#include <cerrno>
#include <chrono>
#include <csignal>
#include <fcntl.h>
#include <future>
#include <memory>
#include <poll.h>
#include <string>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/port_log.hpp"
#include "tests/support/refused_calls.hpp"
#include "tests/tty/played_line.hpp"

namespace porttape {
namespace {

class ModemWatchTest : public testing::Test {
 protected:
  ModemWatchTest() {
    int ends[2];
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, ends), 0);
    tty.reset(ends[0]);
    other.reset(ends[1]);
  }
  void start(std::optional<int> known = 0) {
    watch = ModemWatch::start(loop, line, tty.get(), known, [this](const LineSignal& s) { log.told(s); });
    ASSERT_NE(watch, nullptr);
  }
  void until(const std::string& told) {
    run_until(loop, [&] { return log.events.size() >= told.size(); });
    EXPECT_EQ(log.events, told);
  }
  // The thread is on its way into the wait.
  void until_waits(int count) {
    run_until(loop, [&] {
      loop.post([] {});
      return line->waits >= count;
    });
  }
  static bool ends(const std::shared_future<void>& left) {
    return left.wait_for(std::chrono::seconds(60)) == std::future_status::ready;
  }

  Loop loop;
  PortLog log;
  std::shared_ptr<PlayedLine> line = std::make_shared<PlayedLine>();
  UniqueFd tty;  // of the watch nothing but a descriptor
  UniqueFd other;
  std::unique_ptr<ModemWatch> watch;
};

TEST_F(ModemWatchTest, TellsHowTheLinesStandWhereThatIsNotKnown) {
  line->change(TIOCM_CTS | TIOCM_CD, {}, false);
  start(std::nullopt);
  until("cts+ dsr- cd+ ri- ");
}

TEST_F(ModemWatchTest, TellsWhatIsOtherwiseThanKnown) {
  line->change(TIOCM_CTS | TIOCM_CD, {}, false);
  start(TIOCM_CTS);
  until("cd+ ");
}

TEST_F(ModemWatchTest, TellsEachChangeAtOnce) {
  start();
  until_waits(1);
  line->change(TIOCM_CTS, {.cts = 1});
  until("cts+ ");
  line->change(TIOCM_CTS | TIOCM_RNG, {.cts = 1});
  until("cts+ ri+ ");
  line->change(TIOCM_DSR, {.cts = 2, .dsr = 1, .ri = 1});
  until("cts+ ri+ cts- dsr+ ri- ");
}

TEST_F(ModemWatchTest, APulseThatIsOverIsKnownByTheCounters) {
  line->change(TIOCM_CD, {.cd = 7, .ri = 3}, false);
  start(TIOCM_CD);
  until_waits(1);
  line->change(TIOCM_CD, {.cd = 9, .ri = 4});
  until("cd- cd+ ri+ ri- ");
}

TEST_F(ModemWatchTest, ABreakIsKnownByItsCounter) {
  start();
  until_waits(1);
  line->change(0, {.breaks = 1}, false);
  watch->look_soon();
  until("break+ break- ");
}

TEST_F(ModemWatchTest, WhatNoWaitTellsIsFoundLater) {
  start();
  until_waits(1);
  line->change(TIOCM_CTS, {.cts = 1}, false);
  until("cts+ ");
}

TEST_F(ModemWatchTest, WhereThereIsNoWaitItLooksByTheClock) {
  line->wait_error = ENOTTY;
  start();
  until_waits(1);
  line->change(TIOCM_CTS, {}, false);
  until("cts+ ");
  EXPECT_EQ(line->waits, 1);
  watch.reset();
}

TEST_F(ModemWatchTest, SoItDoesWhereTheWaitNeverWaits) {
  line->never_waits = true;
  start();
  run_until(loop, [&] {
    loop.post([] {});
    return line->looks > 40;
  });
  EXPECT_EQ(line->waits, 17) << "one more than it lets pass in a row";
}

TEST_F(ModemWatchTest, WithoutModemLinesItEnds) {
  line->lose_lines();
  start(std::nullopt);
  EXPECT_TRUE(ends(watch->left()));
  EXPECT_EQ(line->waits, 0);
}

TEST_F(ModemWatchTest, ItEndsWithTheDevice) {
  start();
  until_waits(1);
  line->lose_lines();
  line->end_wait();
  EXPECT_TRUE(ends(watch->left()));
}

TEST_F(ModemWatchTest, EndsThoughTheDriverWaitsAndClosesItsDescriptor) {
  start();
  until_waits(1);
  tty.reset();
  char byte = 0;
  EXPECT_EQ(::read(other.get(), &byte, 1), -1) << "the watch has it open";
  const std::shared_future<void> left = watch->left();
  watch.reset();
  ASSERT_TRUE(ends(left));
  EXPECT_EQ(::read(other.get(), &byte, 1), 0);
}

TEST_F(ModemWatchTest, EndsAtAnyMoment) {
  for (int i = 0; i < 200; ++i) {
    start();
    if (i % 2 == 0) until_waits(line->waits + 1);
    const std::shared_future<void> left = watch->left();
    watch.reset();
    ASSERT_TRUE(ends(left));
  }
}

TEST_F(ModemWatchTest, ADeviceThatHangsHoldsUpNobody) {
  line->hang();
  start();
  until_waits(1);
  const std::shared_future<void> left = watch->left();
  watch.reset();
  EXPECT_EQ(left.wait_for(std::chrono::seconds(0)), std::future_status::timeout);
  line->release();
  EXPECT_TRUE(ends(left));
}

TEST_F(ModemWatchTest, TellsNothingOnceItIsDestroyed) {
  start();
  until_waits(1);
  line->change(TIOCM_CTS);
  until_waits(2);  // it has told the loop, which has perhaps not come to it
  const std::string events = log.events;
  watch.reset();
  while (loop.poll_one()) {
  }
  EXPECT_EQ(log.events, events);
}

TEST_F(ModemWatchTest, OutlivesTheLoopThatItTells) {
  auto own = std::make_unique<Loop>();
  watch = ModemWatch::start(*own, line, tty.get(), 0, [](const LineSignal&) {});
  ASSERT_NE(watch, nullptr);
  own.reset();
  line->change(TIOCM_CTS);
  until_waits(2);
}

TEST_F(ModemWatchTest, LeavesASignalAloneThatSomebodyElseHas) {
  struct sigaction before {};
  struct sigaction others {};
  others.sa_handler = [](int) {};
  ASSERT_EQ(::sigaction(SIGURG, &others, &before), 0);
  EXPECT_EQ(ModemWatch::start(loop, line, tty.get(), 0, [](const LineSignal&) {}), nullptr);
  ASSERT_EQ(::sigaction(SIGURG, &before, nullptr), 0);
}

TEST_F(ModemWatchTest, WhatCannotBeHadMeansNoWatchAndLeavesNothing) {
  const test::RefusedCall::Argument duplicates{1, 0xffffffff, F_DUPFD_CLOEXEC};
  const std::vector<test::RefusedCall> cases[] = {
      {{SYS_rt_sigaction, EINVAL}},
      {{SYS_fcntl, EMFILE, duplicates}},
#ifdef SYS_clone3
      {{SYS_clone3, EAGAIN}, {SYS_clone, EAGAIN}},
#endif
  };
  for (const auto& calls : cases) {
    sigset_t mask;
    EXPECT_TRUE(test::while_refused(calls, [&] {
      EXPECT_EQ(ModemWatch::start(loop, line, tty.get(), 0, [](const LineSignal&) {}), nullptr);
      ::pthread_sigmask(SIG_SETMASK, nullptr, &mask);
    }));
    EXPECT_EQ(::sigismember(&mask, SIGTERM), 0) << "the caller's signals are as they were";
  }
  tty.reset();
  pollfd hung_up{other.get(), 0, 0};
  EXPECT_EQ(::poll(&hung_up, 1, 0), 1) << "nobody else has it open";
}

// The thread's own timer does not run here: what ends its wait is the caller's.
TEST_F(ModemWatchTest, ALookThatIsWantedAndTheEndWaitForNoTimeOfTheThreads) {
  EXPECT_TRUE(test::while_refused({{SYS_timer_settime, EINVAL}}, [&] { start(); }));
  until_waits(1);
  line->change(TIOCM_CTS, {}, false);
  watch->look_soon();
  until("cts+ ");
  EXPECT_TRUE(test::while_refused({{SYS_timer_settime, EINVAL}}, [&] { start(0); }));
  const std::shared_future<void> left = watch->left();
  watch.reset();
  EXPECT_TRUE(ends(left));
}

TEST_F(ModemWatchTest, WithoutATimerTheDeviceIsLookedAtAndNotWaitedFor) {
  EXPECT_TRUE(test::while_refused({{SYS_timer_create, EAGAIN}}, [&] { start(); }));
  line->change(TIOCM_CTS, {}, false);
  until("cts+ ");
  watch->look_soon();
  line->change(0, {}, false);
  until("cts+ cts- ");
  EXPECT_EQ(line->waits, 0) << "nothing could end such a wait";
  const std::shared_future<void> left = watch->left();
  watch.reset();
  EXPECT_TRUE(ends(left));
}

TEST(ModemLines, EachHasItsBitAndTheOthersNone) {
  EXPECT_EQ(modem_bit(LineSignal::Name::cts), TIOCM_CTS);
  EXPECT_EQ(modem_bit(LineSignal::Name::dsr), TIOCM_DSR);
  EXPECT_EQ(modem_bit(LineSignal::Name::cd), TIOCM_CD);
  EXPECT_EQ(modem_bit(LineSignal::Name::ri), TIOCM_RNG);
  for (const LineSignal::Name name : {LineSignal::Name::dtr, LineSignal::Name::rts, LineSignal::Name::brk})
    EXPECT_EQ(modem_bit(name), 0) << name_of(name);
}

TEST(ModemLines, AreToldWhereTheyAreOtherwiseThanBefore) {
  const auto told = [](std::optional<int> before, int lines) {
    PortLog log;
    tell_modem_lines(before, lines, [&log](const LineSignal& signal) { log.told(signal); });
    return log.events;
  };
  EXPECT_EQ(told(std::nullopt, TIOCM_DSR | TIOCM_RNG), "cts- dsr+ cd- ri+ ");
  EXPECT_EQ(told(TIOCM_CTS, TIOCM_CTS), "");
  EXPECT_EQ(told(TIOCM_CTS | TIOCM_CD, TIOCM_CD | TIOCM_DSR), "cts- dsr+ ");
  EXPECT_EQ(told(TIOCM_DTR, TIOCM_RTS), "") << "not the device's";
}

}  // namespace
}  // namespace porttape
