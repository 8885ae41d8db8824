// When a row of failures is over and what is told of it then; what leads a session from one of its states to
// the next; and that a session which is over does nothing.

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/loop/backoff.hpp"
#include "tests/session/session_rig.hpp"

namespace porttape {
namespace {

using Reason = LineDown::Reason;
using std::chrono::seconds;
using testing::ElementsAre;
using testing::IsEmpty;

class SessionRowTest : public SessionRig {
 protected:
  SessionRowTest() { start(); }
  void pass(Nanos time) { (void)let_pass(loop, clock, time); }
  [[nodiscard]] int times_told(const std::string& text) const {
    const std::string all = book.text();
    int count = 0;
    for (std::size_t at = all.find(text); at != std::string::npos; at = all.find(text, at + 1)) ++count;
    return count;
  }
  // A driver comes, its device is up for so long and is lost.
  void lose_after(Nanos time) {
    driver.up();
    pass(seconds(1));  // longer than any device waits to be opened
    device.up();
    pass(time);
    device.down(Reason::lost, "it is gone");
    driver.down(Reason::hung_up);
  }
};

TEST_F(SessionRowTest, ADeviceThatWasUpForASecondEndsTheRow) {
  device.up_at_once = false;
  lose_after(kLineHeld);
  EXPECT_EQ(times_told("it is gone"), 1);
  lose_after(kLineHeld - Nanos(1));
  EXPECT_EQ(times_told("it is gone"), 1) << "it was up for a little less";
  lose_after(kLineHeld);
  EXPECT_EQ(times_told("it is gone"), 2);
  lose_after(kLineHeld);
  EXPECT_EQ(times_told("it is gone"), 3);
}

TEST_F(SessionRowTest, ADeviceThatWasBackForASecondEndsTheRow) {
  driver.up();
  device.interrupt();
  EXPECT_EQ(times_told("; waiting for it"), 1);
  device.resume();
  pass(kLineHeld - Nanos(1));
  device.interrupt();
  EXPECT_EQ(times_told("; waiting for it"), 1) << "it was back for a little less";
  device.resume();
  pass(kLineHeld);
  device.interrupt();
  EXPECT_EQ(times_told("; waiting for it"), 2);
}

TEST_F(SessionRowTest, WhatFailedInTheSameWayIsCountedAtTheEndToo) {
  device.up_at_once = false;
  for (int n = 0; n < 5; ++n) lose_after(Nanos(0));
  EXPECT_FALSE(told("more times in the same way"));
  session->stop();
  settle(loop);
  EXPECT_EQ(end_status, 0);
  EXPECT_EQ(times_told("device: it had failed 4 more times in the same way"), 1) << book.text();
}

TEST_F(SessionRowTest, WhatFailedInTheSameWayIsCountedWhenALineThatHeldFails) {
  device.up_at_once = false;
  for (int n = 0; n < 3; ++n) lose_after(Nanos(0));
  lose_after(kLineHeld);
  EXPECT_EQ(times_told("device: it had failed 2 more times in the same way"), 1) << book.text();
  EXPECT_EQ(times_told("it is gone"), 2);
}

TEST_F(SessionRowTest, WhatReachedNobodyMeanwhileIsToldOnceTheDeviceWorks) {
  device.up_at_once = false;
  for (int n = 0; n < 2; ++n) lose_after(Nanos(0));
  driver.up();
  pass(seconds(1));
  device.up();
  driver.drop(7);
  EXPECT_FALSE(told("reached nobody"));
  device.send("works");
  EXPECT_TRUE(told("device: works again"));
  EXPECT_TRUE(told("7 bytes reached nobody (the last because a test wants it)")) << book.text();
}

TEST_F(SessionRowTest, WhereNothingFailedTheEndTellsNothingOfIt) {
  driver.up();
  session->stop();
  driver.down(Reason::hung_up);
  settle(loop);
  EXPECT_EQ(end_status, 0);
  EXPECT_FALSE(told("had failed")) << book.text();
}

// What the device is told of the programs at the driver's side.
TEST_F(SessionRowTest, WhatDriversLeftUnreadAndWroteInVainIsPassedOn) {
  driver.up();
  driver.refuse(3);
  driver.refuse(0);
  driver.leave_unread(7);
  EXPECT_THAT(device.refused, ElementsAre(3, 0));
  EXPECT_THAT(device.left_unread, ElementsAre(7));
  EXPECT_THAT(driver.refused, IsEmpty());
  EXPECT_THAT(driver.left_unread, IsEmpty());
}

// Each side has bytes that its port should not have read when it is told not to read once more.
TEST_F(SessionRowTest, WhatWasKeptWaitsUntilTheOtherSideTakesIt) {
#ifndef NDEBUG
  GTEST_SKIP() << "builds with assertions end there";
#endif
  driver.up();
  device.congested = true;
  driver.send("1");
  driver.send("2");
  device.interrupt();
  EXPECT_EQ(device.written, "1") << "it is not there";
  device.congested = false;
  device.resume();
  EXPECT_EQ(device.written, "12");
  driver.congested = true;
  device.send("3");
  device.send("4");
  driver.interrupt();
  EXPECT_EQ(driver.written, "3") << "it is not there";
  driver.congested = false;
  driver.resume();
  EXPECT_EQ(driver.written, "34");
}

TEST_F(SessionRowTest, ADeviceThatIsBackIsOpenAgain) {
  driver.up();
  device.interrupt();
  EXPECT_EQ(session->state(), Session::State::interrupted);
  device.resume();
  EXPECT_EQ(session->state(), Session::State::open);
  EXPECT_EQ(driver.end(), PortListener::Answers::until_hang_up) << "its half-close is passed on";
}

TEST_F(SessionRowTest, WhileTheDriverIsInterruptedTheDeviceIsNotRead) {
  driver.up();
  driver.interrupt();
  EXPECT_TRUE(told("; waiting for it")) << book.text();
  EXPECT_FALSE(device.reading);
  driver.drain();
  device.drain();
  EXPECT_FALSE(device.reading);
  driver.resume();
  EXPECT_TRUE(device.reading);
  driver.interrupt();
  driver.down(Reason::closed);
  EXPECT_TRUE(device.reading) << "the next one is not interrupted";
}

TEST_F(SessionRowTest, ADriversArrivalsStayApartOnlyWhereTheDeviceKeepsDatagrams) {
  driver.up();
  driver.arrive("abcd", {1, 4});
  EXPECT_EQ(device.writes, 1);
  device.datagrams = true;
  driver.arrive("efgh", {1, 4});
  EXPECT_EQ(device.writes, 3);
  EXPECT_EQ(device.written, "abcdefgh");
}

TEST_F(SessionRowTest, WhatADriverSendsToADeviceThatIsLostIsReadAndReachesNobody) {
  driver.up();
  device.congested = true;
  driver.send("much");
  EXPECT_FALSE(driver.reading);
  device.down(Reason::lost, "it is gone");
  EXPECT_TRUE(driver.reading);
}

TEST_F(SessionRowTest, ADeviceThatTakesTheLastBytesIsRead) {
  driver.up();
  driver.congested = true;
  device.send("much");
  EXPECT_FALSE(device.reading);
  device.congested = true;
  driver.congested = false;
  driver.down(Reason::closed);
  EXPECT_EQ(session->state(), Session::State::draining);
  EXPECT_TRUE(device.reading);
}

// Each way in which the line of a driver that has gone ends, once.
TEST_F(SessionRowTest, TheLastBytesEndWithTheDevicesLine) {
  const std::vector<std::function<void()>> ends{[this] { device.drain(); }, [this] { device.interrupt(); },
                                                [this] { device.down(Reason::lost, "it is gone"); }};
  for (const auto& comes : ends) {
    device.calls.clear();
    driver.up();
    device.congested = true;
    driver.down(Reason::closed);
    EXPECT_EQ(device.calls, "open ");
    comes();
    EXPECT_EQ(device.calls, "open close ");
    EXPECT_EQ(session->state(), Session::State::waiting);
    pass(seconds(40));
    EXPECT_EQ(device.calls, "open close ");
  }
  EXPECT_FALSE(told("does not take the driver's last bytes")) << book.text();
}

TEST_F(SessionRowTest, LastBytesThatStandStillAfterSomeHaveGoneAreGivenUpForANextDriver) {
  driver.up();
  device.congested = true;
  device.unread = 10;
  driver.down(Reason::closed);
  driver.up();
  --*device.unread;
  pass(seconds(1));
  EXPECT_EQ(session->state(), Session::State::draining) << "some have gone";
  EXPECT_FALSE(told("they are dropped"));
  pass(seconds(1));
  EXPECT_EQ(session->state(), Session::State::open) << "none have";
  EXPECT_TRUE(told("device does not take the driver's last bytes; they are dropped"));
}

// What an end waits for, and what lets it go on at once.
TEST_F(SessionRowTest, AnEndGoesOnWithTheDriversQueue) {
  driver.up();
  driver.congested = true;
  session->stop();
  EXPECT_EQ(driver.calls, "prepare open ");
  driver.drain();
  EXPECT_EQ(driver.calls, "prepare open hang_up_after_reading ");
}

TEST_F(SessionRowTest, AnEndGoesOnWhereTheDeviceIsInterruptedAndHasNothingLeft) {
  driver.up();
  device.congested = true;
  session->stop();
  EXPECT_EQ(driver.calls, "prepare open ");
  device.congested = false;
  device.interrupt();
  EXPECT_EQ(driver.calls, "prepare open hang_up_after_reading ");
}

TEST_F(SessionRowTest, AnEndGoesOnWhereTheDevicesPeerHasClosed) {
  device.passive = true;
  driver.up();
  device.congested = true;
  session->stop();
  EXPECT_EQ(driver.calls, "prepare open ");
  device.down(Reason::closed);
  EXPECT_EQ(driver.calls, "prepare open hang_up_after_reading ");
}

TEST_F(SessionRowTest, AnEndGoesOnWhereTheLineOfTheLastBytesIsLost) {
  driver.up();
  device.congested = true;
  driver.down(Reason::closed);
  session->stop();
  settle(loop);
  EXPECT_EQ(end_status, std::nullopt);
  device.down(Reason::lost, "it is gone");
  settle(loop);
  EXPECT_EQ(end_status, 0);
}

TEST_F(SessionRowTest, AnEndGoesOnWhereADriverThatDoesNotComeBackLeaves) {
  driver.passive = false;
  driver.up();
  driver.congested = true;
  session->stop();
  settle(loop);
  EXPECT_EQ(end_status, std::nullopt);
  driver.down(Reason::closed);
  settle(loop);
  EXPECT_EQ(end_status, 0);
}

TEST_F(SessionRowTest, AtTheEndADriverIsReadWhoseDeviceIsNotThere) {
  device.up_at_once = false;
  driver.up();
  EXPECT_FALSE(driver.reading);
  driver.congested = true;
  session->stop();
  EXPECT_TRUE(driver.reading);
}

TEST_F(SessionRowTest, ADriversLineIsHungUpOnceAtTheEnd) {
  driver.up();
  session->stop();
  device.drain();
  driver.drain();
  EXPECT_EQ(driver.calls, "prepare open hang_up_after_reading ");
  driver.down(Reason::hung_up);
  settle(loop);
  EXPECT_EQ(end_status, 0);
}

TEST_F(SessionRowTest, WhatADriverHasWrittenAndNobodyTookIsCountedWhereAnEndIsGivenUp) {
  driver.up();
  device.congested = true;
  driver.send("much");
  session->stop();
  driver.pending = [this] {
    if (driver.reading) driver.send("abc");
  };
  session->stop();
  settle(loop);
  EXPECT_EQ(session->counters().dropped_bytes, 3U);
  EXPECT_EQ(device.gaps, 3U);
}

TEST_F(SessionRowTest, AfterAnEndThatWasGivenUpNothingComesOfTheLastBytes) {
  driver.up();
  device.congested = true;
  driver.down(Reason::closed);
  session->stop();
  session->stop();
  settle(loop);
  EXPECT_EQ(end_status, 0);
  const std::string calls = device.calls;
  pass(seconds(60));
  EXPECT_EQ(device.calls, calls);
  EXPECT_FALSE(told("does not take the driver's last bytes")) << book.text();
}

TEST_F(SessionRowTest, WhatADriverWaitsForAndAsksIsTheDevicesToAnswer) {
  driver.up();
  int sent = 0;
  int answers = 0;
  driver.wait_until_sent([&sent] { ++sent; });
  driver.ask([&answers](const auto&) { ++answers; });
  ASSERT_EQ(device.drains.size(), 1U);
  ASSERT_EQ(device.questions.size(), 1U);
  EXPECT_EQ(sent + answers, 0);
  device.drains.front()();
  device.questions.front()(std::nullopt);
  EXPECT_EQ(sent, 1);
  EXPECT_EQ(answers, 1);
}

TEST_F(SessionRowTest, SignalsOfADriverThatWentBeforeItsDeviceCameAreNotTheNextOnes) {
  device.up_at_once = false;
  driver.up();
  driver.signal({LineSignal::Name::dtr, true});
  driver.down(Reason::closed);
  driver.up();
  device.up();
  EXPECT_EQ(device.calls.find("_on"), std::string::npos) << device.calls;
}

TEST_F(SessionRowTest, AFirstStopAloneLooksForADriverThatNothingHasToldOf) {
  device.completes = false;
  int looks = 0;
  driver.pending = [&looks] { ++looks; };
  session->stop();
  EXPECT_EQ(looks, 1);
  session->stop();
  session->stop();
  EXPECT_EQ(looks, 1) << "no next driver is served";
}

TEST_F(SessionRowTest, OneThatIsGoneBeginsNoEnd) {
  driver.up();
  int calls = 0;
  driver.pending = device.pending = [&calls] { ++calls; };
  device.finish(exit_status::kRuntime);
  session.reset();
  settle(loop);
  EXPECT_EQ(calls, 0);
  EXPECT_EQ(driver.calls + device.calls, "prepare open prepare open ");
  EXPECT_EQ(end_status, std::nullopt);
}

TEST_F(SessionRowTest, OneThatIsGoneTellsNoStatus) {
  session->stop();
  session.reset();
  settle(loop);
  EXPECT_EQ(end_status, std::nullopt);
}

}  // namespace
}  // namespace porttape
