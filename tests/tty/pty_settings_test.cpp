#include "libport/tty/pty_settings.hpp"

#include <algorithm>
#include <functional>
#include <string>
#include <termios.h>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/loop/sampler.hpp"
#include "libport/tty/tty.hpp"
#include "tests/support/time_bound.hpp"
#include "tests/tty/pty_rig.hpp"

namespace porttape {
namespace {

// What a driver makes of its line, and how that is told.
class PtySettingsTest : public PtyPortTest {
 protected:
  void set(const UniqueFd& fd, const std::function<void(termios&)>& change) {
    termios tio{};
    ASSERT_EQ(::tcgetattr(fd.get(), &tio), 0);
    change(tio);
    ASSERT_EQ(::tcsetattr(fd.get(), TCSANOW, &tio), 0);
  }
  void set_rate(const UniqueFd& fd, speed_t rate) {
    set(fd, [rate](termios& tio) { ::cfsetspeed(&tio, rate); });
  }
  void until_baud(unsigned baud) {
    run_until(loop, [&] { return log.settings.baud == baud; });
    EXPECT_EQ(log.settings.baud, baud);
  }
  [[nodiscard]] LineSettings found(const UniqueFd& fd) const {
    const Result<ShownSettings> shown = shown_settings(fd.get());
    return shown ? shown->settings.over(LineSettings{}) : LineSettings{.baud = 1};
  }
  const LineSettings home{.baud = 4800, .stop_bits = 2, .hw_flow = true};
};

TEST_F(PtySettingsTest, EachDriverFindsTheLineAsItIsToBe) {
  ASSERT_TRUE(port.apply(home).has_value());
  start();
  UniqueFd fd = driver();
  until("up ");
  EXPECT_EQ(found(fd), home);
  set_rate(fd, B115200);
  until_baud(115200);
  fd.reset();
  run_until(loop, [&] { return log.events.ends_with("closed "); });
  fd = driver();
  EXPECT_EQ(found(fd), home);
}

// The last one's end and the next one's open and first setting may come within microseconds.
TEST_F(PtySettingsTest, WhatTheNextDriverHasSetAlreadyStays) {
  FileEvents events(loop);
  Result<Pty> pty = Pty::create(events, {});
  ASSERT_TRUE(pty.has_value());
  const UniqueFd next(::open(pty->slave_path().c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK));
  set(next, [](termios& tio) {
    ::cfsetspeed(&tio, B1200);
    tio.c_lflag |= ICANON;
  });
  ASSERT_TRUE(pty->settle(home).has_value());
  termios tio{};
  ASSERT_EQ(::tcgetattr(next.get(), &tio), 0);
  EXPECT_EQ(::cfgetospeed(&tio), B1200);
  EXPECT_NE(tio.c_lflag & ICANON, 0U);
}

TEST_F(PtySettingsTest, ALineThatWasSetSinceItWasLookedAtIsNotMadeFresh) {
  FileEvents events(loop);
  Result<Pty> pty = Pty::create(events, {});
  ASSERT_TRUE(pty.has_value());
  const UniqueFd next(::open(pty->slave_path().c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK));
  const Result<TtyState> before = tty_state(pty->master());
  ASSERT_TRUE(before.has_value());
  set(next, [](termios& tio) { tio.c_cflag |= CLOCAL; });
  ASSERT_TRUE(make_pty_fresh(pty->master(), *before, home).has_value());
  EXPECT_EQ(found(next), home) << "CLOCAL is not counted";
  set_rate(next, B1200);
  ASSERT_TRUE(make_pty_fresh(pty->master(), *before, home).has_value());
  EXPECT_EQ(found(next).baud, 1200U);
}

// Its line is looked at as often as that of any that has just come.
TEST_F(PtySettingsTest, OneThatClosesAndOpensAtOnceMaySetItsLineAgain) {
  start();
  UniqueFd fd = driver();
  until("up ");
  Nanos quickest = Nanos::max();
  for (int n = 0; n < 5 && quickest > Sampler::kRarely / 2; ++n) {  // the machine may hold one up
    const Instant later = loop.now() + Sampler::kYoung + std::chrono::milliseconds(100);
    run_until(loop, [&] { return loop.now() >= later; });
    log.events.clear();
    fd.reset();
    fd = driver();
    until("closed up ");
    termios tio{};
    ASSERT_EQ(::tcgetattr(fd.get(), &tio), 0);
    tio.c_cflag |= CLOCAL;
    ASSERT_EQ(::tcsetattr(fd.get(), TCSANOW, &tio), 0);
    const Instant set_at = loop.now();
    run_until(loop, [&] { return ::tcgetattr(fd.get(), &tio) != 0 || (tio.c_cflag & CLOCAL) == 0; });
    quickest = std::min<Nanos>(quickest, loop.now() - set_at);
  }
  EXPECT_WITHIN(quickest, Sampler::kRarely / 2);
}

TEST_F(PtySettingsTest, WhatADriverFindsIsNoNews) {
  ASSERT_TRUE(port.apply(home).has_value());
  start();
  const UniqueFd fd = driver();
  until("up ");
  set(fd, [](termios& tio) { tio.c_cc[VMIN] = 7; });
  ASSERT_EQ(::write(fd.get(), "x", 1), 1);
  run_until(loop, [&] { return log.data == "x"; });
  EXPECT_EQ(log.events, "up ");
}

TEST_F(PtySettingsTest, IgnbrkIsSetAgainForADriverThatHasLeftItsLineAloneAndLeavesClocalAlone) {
  FileEvents events(loop);
  Result<Pty> pty = Pty::create(events, {});
  ASSERT_TRUE(pty.has_value());
  const UniqueFd fd(::open(pty->slave_path().c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK));
  PtySettings settings(pty->master());
  const auto is_set_after_a_look = [&] {
    (void)settings.look(false);
    termios tio{};
    return ::tcgetattr(fd.get(), &tio) == 0 && (tio.c_iflag & static_cast<tcflag_t>(IGNBRK)) != 0;
  };
  set(fd, [](termios& tio) { tio.c_iflag &= ~static_cast<tcflag_t>(IGNBRK); });
  EXPECT_FALSE(is_set_after_a_look()) << "tcsetattr itself reads back at once";
  EXPECT_TRUE(is_set_after_a_look());
  set(fd, [](termios& tio) {
    tio.c_iflag &= ~static_cast<tcflag_t>(IGNBRK);
    tio.c_cflag |= CLOCAL;
  });
  for (int look = 0; look < 3; ++look) EXPECT_FALSE(is_set_after_a_look()) << look;
}

TEST_F(PtySettingsTest, AnyRateStopBitsAndFlowControlAreTold) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  ASSERT_TRUE(apply_settings(fd.get(), {.baud = 250000, .stop_bits = 2, .sw_flow = true}).has_value());
  until_baud(250000);
  EXPECT_EQ(log.settings.stop_bits, 2U);
  EXPECT_EQ(log.settings.sw_flow, true);
  EXPECT_EQ(log.settings.parity, std::nullopt) << "a pty does not show it";
  EXPECT_EQ(log.settings.data_bits, std::nullopt);
  EXPECT_EQ(log.settings_order, SettingsOrder::exact) << "no byte was there";
  set_rate(fd, B0);
  until_baud(0);
}

TEST_F(PtySettingsTest, AChangeBesideBytesIsToldBeforeThemAndAsUncertain) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  set_rate(fd, B1200);
  ASSERT_EQ(::write(fd.get(), "x", 1), 1);
  run_until(loop, [&] { return log.data == "x"; });
  EXPECT_EQ(log.settings.baud, 1200U);
  EXPECT_EQ(log.settings_after, 0U);
  EXPECT_EQ(log.settings_order, SettingsOrder::sampled);
}

TEST_F(PtySettingsTest, AChangeJustBeforeTheCloseIsTold) {
  start();
  UniqueFd fd = driver();
  until("up ");
  set_rate(fd, B1200);
  fd.reset();
  until("up settings closed ");
  EXPECT_EQ(log.settings.baud, 1200U);
}

TEST_F(PtySettingsTest, WhatIsShownToADriverThatHasItOpenIsNotTheNextOnes) {
  ASSERT_TRUE(port.apply(home).has_value());
  start();
  UniqueFd fd = driver();
  until("up ");
  ASSERT_TRUE(port.apply({.baud = 300}).has_value());  // its device took this
  EXPECT_EQ(found(fd).baud, 300U);
  fd.reset();
  until("up closed ");
  fd = driver();
  EXPECT_EQ(found(fd), home);
}

TEST_F(PtySettingsTest, ANewPtyShowsThemToo) {
  ASSERT_TRUE(port.apply(home).has_value());
  start();
  const UniqueFd fd = driver();
  until("up ");
  port.hang_up(false);
  until("up hung_up ");
  const UniqueFd next = driver();
  EXPECT_EQ(found(next), home);
}

TEST_F(PtySettingsTest, AFloodOfChangesIsToldAsFarAsItIsSeenAndEndsInTheLast) {
  start();
  const UniqueFd fd = driver();
  until("up ");
  const std::string logged = book.text();
  for (int i = 0; i < 2000; ++i) {
    set_rate(fd, i % 2 == 0 ? B1200 : B2400);
    while (loop.poll_one()) {
    }
  }
  set_rate(fd, B57600);
  until_baud(57600);
  EXPECT_EQ(book.text(), logged);
}

}  // namespace
}  // namespace porttape
