// What a PtyPort and the supervisor of its driver tell each other.

#include <fmt/format.h>
#include <functional>
#include <optional>
#include <string>
#include <termios.h>
#include <unistd.h>
#include <utility>

#include <gtest/gtest.h>

#include "libport/base/tty_device.hpp"
#include "libport/port/supervised_line.hpp"
#include "tests/support/manual_clock.hpp"
#include "tests/support/port_log.hpp"
#include "tests/tty/pty_rig.hpp"

namespace porttape {
namespace {

using Name = LineSignal::Name;

struct Supervisor final : LineSupervisor {
  void line_opened() override { told += "opened "; }
  void line_closed() override { told += "closed "; }
  void line_shows(const LineSettings& settings) override { told += fmt::format("{} ", settings.baud); }
  void line_signalled(const LineSignal& signal) override {
    told += fmt::format("{}{} ", name_of(signal.name), signal.on ? '+' : '-');
  }
  void line_gone() override { told += "gone "; }

  std::string told;
};

// Lives longer than the port, which tells it of its own end.
struct WithSupervisor {
  Supervisor supervisor;
};

class PtySupervised : public WithSupervisor, public PtyPortTest {
 protected:
  void start_supervised() {
    line().supervise(&supervisor);
    start();
  }
  SupervisedLine& line() { return *port.supervised(); }
  // What was told since the last call.
  std::string told() { return std::exchange(supervisor.told, {}); }
  void set_rate(const UniqueFd& fd, speed_t rate) {
    termios settings{};
    ASSERT_EQ(::tcgetattr(fd.get(), &settings), 0);
    ASSERT_EQ(::cfsetspeed(&settings, rate), 0);
    ASSERT_EQ(::tcsetattr(fd.get(), TCSANOW, &settings), 0);
  }
};

TEST_F(PtySupervised, AnOpenAndTheLastCloseAreTold) {
  start_supervised();
  EXPECT_EQ(told(), "");
  UniqueFd fd = driver();
  until("up ");
  EXPECT_EQ(told(), "opened ");
  UniqueFd second = driver();
  settle(loop);
  fd.reset();
  settle(loop);
  EXPECT_EQ(told(), "") << "somebody still has it";
  second.reset();
  until("up closed ");
  EXPECT_EQ(told(), "closed ");
}

TEST_F(PtySupervised, AReopenThatIsSeenLateIsAnEndAndABeginning) {
  start_supervised();
  UniqueFd fd = driver();
  until("up ");
  fd.reset();
  fd = driver();
  until("up closed up ");
  EXPECT_EQ(told(), "opened closed opened ");
}

TEST_F(PtySupervised, AHangUpIsTheEndAndWithoutADriverThereIsNone) {
  start_supervised();
  port.hang_up(false);
  settle(loop);
  EXPECT_EQ(told(), "");
  const UniqueFd fd = driver();
  until("up ");
  port.hang_up(false);
  until("up hung_up ");
  EXPECT_EQ(told(), "opened closed ");
}

TEST_F(PtySupervised, OneThatComesLaterIsToldHowTheLineStands) {
  ASSERT_TRUE(port.apply({.baud = 4800}).has_value());
  start();
  line().supervise(&supervisor);
  EXPECT_EQ(told(), "4800 ");
  line().supervise(nullptr);
  const UniqueFd fd = driver();
  until("up ");
  EXPECT_EQ(told(), "") << "it is no supervisor any more";
  line().supervise(&supervisor);
  EXPECT_EQ(told(), "4800 opened ");
}

TEST_F(PtySupervised, TheDevicesSettingsAndSignalsAreTold) {
  start_supervised();
  ASSERT_TRUE(port.apply({.baud = 4800}).has_value());
  UniqueFd fd = driver();
  until("up ");
  ASSERT_TRUE(port.apply({.baud = 2400}).has_value());
  EXPECT_TRUE(port.shows_signals());
  port.tell(LineSignal{Name::cts, true});
  port.tell(LineSignal{Name::brk, false});
  EXPECT_EQ(told(), "4800 opened 2400 cts+ break- ");
  fd.reset();
  until("up closed ");
  EXPECT_EQ(told(), "closed 4800 ") << "the next driver finds the line as before";
}

TEST_F(PtySupervised, WithoutASupervisorASignalIsShownToNobody) {
  start();
  EXPECT_FALSE(port.shows_signals());
  port.tell(LineSignal{Name::cts, true});
  EXPECT_EQ(log.events, "");
}

TEST(PtySupervisedEnd, TheEndOfThePortIsTold) {
  Loop loop;
  const LogBook book;
  Supervisor supervisor;
  {
    PtyPort port(PortContext{&loop, book.log()}, {});
    port.supervised()->supervise(&supervisor);
  }
  EXPECT_EQ(supervisor.told, "gone ");
}

TEST_F(PtySupervised, SettingsAreToldByTheSupervisorAloneUntilItGoes) {
  start_supervised();
  const UniqueFd fd = driver();
  until("up ");
  set_rate(fd, B4800);
  ASSERT_EQ(::write(fd.get(), "x", 1), 1);
  run_until(loop, [&] { return log.data == "x"; });
  EXPECT_EQ(log.events, "up ") << "a look would have seen it";
  for (const SettingsOrder order : {SettingsOrder::sampled, SettingsOrder::exact}) {
    log.events.clear();
    line().peer_did(line::Settings{{.baud = 4800}, order});
    EXPECT_EQ(log.events, "settings ");
    EXPECT_EQ(log.settings.baud, 4800U);
    EXPECT_EQ(log.settings_order, order);
  }
  log.events.clear();
  line().supervise(nullptr);
  ASSERT_EQ(::write(fd.get(), "y", 1), 1);
  run_until(loop, [&] { return log.data == "xy"; });
  EXPECT_EQ(log.events, "") << "what was made is known";
  set_rate(fd, B2400);
  ASSERT_EQ(::write(fd.get(), "z", 1), 1);
  run_until(loop, [&] { return log.data == "xyz"; });
  EXPECT_EQ(log.events, "settings ");
  EXPECT_EQ(log.settings.baud, 2400U);
}

TEST_F(PtySupervised, OfALineThatIsNotUpNoSettingsAreTold) {
  start_supervised();
  line().peer_did(line::Settings{{.baud = 4800}, SettingsOrder::exact});
  EXPECT_EQ(log.events, "");
}

TEST_F(PtySupervised, AFlushIsToldAsItIsTold) {
  start_supervised();
  line().peer_did(line::Flush{FlushQueue::in});
  line().peer_did(line::Flush{FlushQueue::out});
  line().peer_did(line::Flush{FlushQueue::both});
  EXPECT_EQ(log.events, "flush_in flush_out flush_both ");
}

TEST_F(PtySupervised, AFlushThatTheKernelTellsOfIsNotToldAgain) {
  start_supervised();
  const UniqueFd fd = driver();
  until("up ");
  ASSERT_EQ(::tcflush(fd.get(), TCIOFLUSH), 0);
  ASSERT_EQ(::write(fd.get(), "x", 1), 1);
  run_until(loop, [&] { return log.data == "x"; });
  EXPECT_EQ(log.events, "up ");
}

TEST_F(PtySupervised, AFlushOfWhatComesInEndsTheCongestionAndOneOfTheRestDoesNot) {
  start_supervised();
  const UniqueFd fd = driver();
  until("up ");
  while (!port.congested()) port.write(as_bytes(std::string(4096, 'q')));
  line().peer_did(line::Flush{FlushQueue::out});
  EXPECT_TRUE(port.congested());
  EXPECT_EQ(log.events, "up flush_out ");
  line().peer_did(line::Flush{FlushQueue::in});
  EXPECT_FALSE(port.congested());
  EXPECT_EQ(log.events, "up flush_out drained flush_in ");
  EXPECT_EQ(port.unread_by_peer(), 0U) << "nor has the driver anything to read";
  line().peer_did(line::Flush{FlushQueue::in});
  EXPECT_EQ(log.events, "up flush_out drained flush_in flush_in ");
}

TEST_F(PtySupervised, SignalsOfADriverThatIsEarlyWaitForTheLine) {
  start_supervised();
  port.close();
  const UniqueFd fd = driver();
  settle(loop);
  line().peer_did(LineSignal{Name::dtr, true});
  line().peer_did(LineSignal{Name::rts, false});
  EXPECT_EQ(log.events, "");
  port.open();
  settle(loop);
  EXPECT_EQ(log.events, "up dtr+ rts- ");
  line().peer_did(LineSignal{Name::rts, true});
  EXPECT_EQ(log.events, "up dtr+ rts- rts+ ");
}

TEST_F(PtySupervised, SignalsBetweenTwoSessionsAreTheNextOnesUnlessTheDriverIsAnother) {
  start_supervised();
  UniqueFd fd = driver();
  until("up ");
  port.close();
  line().peer_did(LineSignal{Name::dtr, true});
  line().peer_did(LineSignal{Name::rts, false});
  EXPECT_EQ(log.events, "up ");
  port.open();
  EXPECT_EQ(log.events, "up up dtr+ rts- ");
  port.close();
  line().peer_did(LineSignal{Name::dtr, false});
  fd.reset();
  fd = driver();
  settle(loop);
  port.open();
  EXPECT_EQ(log.events.find("dtr-"), std::string::npos) << "that was the last driver's";
}

TEST_F(PtySupervised, ADrainOrAQuestionIsTheListenersWhileTheLineIsUp) {
  start_supervised();
  int done = 0;
  std::optional<LineAnswer> answer = LineAnswer{};
  const auto wait_and_ask = [&] {
    line().wait_until_sent([&] { ++done; });
    line().ask({}, [&](const std::optional<LineAnswer>& given) { answer = given; });
  };
  wait_and_ask();
  EXPECT_EQ(done, 1);
  EXPECT_EQ(answer, std::nullopt);
  EXPECT_EQ(log.events, "") << "there is nobody to wait for";
  const UniqueFd fd = driver();
  until("up ");
  log.answers_to = &port;
  wait_and_ask();
  EXPECT_EQ(done, 2);
  EXPECT_EQ(log.events, "up drain ");
}

TEST_F(PtySupervised, CatchingUpPassesOnWhatIsThereUnlessItHasToWait) {
  start_supervised();
  EXPECT_TRUE(line().catch_up());
  const UniqueFd fd = driver();
  EXPECT_TRUE(line().catch_up());
  EXPECT_EQ(log.events, "up ");
  EXPECT_EQ(told(), "opened ");
  ASSERT_EQ(::write(fd.get(), "now", 3), 3);
  EXPECT_TRUE(line().catch_up());
  EXPECT_EQ(log.data, "now");
  port.set_reading(false);
  EXPECT_TRUE(line().catch_up()) << "there is nothing";
  ASSERT_EQ(::write(fd.get(), "later", 5), 5);
  EXPECT_FALSE(line().catch_up());
  EXPECT_EQ(log.data, "now");
  port.set_reading(true);
  EXPECT_TRUE(line().catch_up());
  EXPECT_EQ(log.data, "nowlater");
}

TEST_F(PtySupervised, TheLineIsKnownByItsDeviceWhileThereIsOne) {
  EXPECT_EQ(line().line_fd(), -1);
  EXPECT_FALSE(line().line_device());
  start_supervised();
  const UniqueFd fd = driver();
  const auto device = line().line_device();
  const auto theirs = tty_device_of(fd.get());
  ASSERT_TRUE(device && theirs);
  EXPECT_TRUE(device->is(*theirs));
  EXPECT_GE(line().line_fd(), 0);
}

}  // namespace
}  // namespace porttape
