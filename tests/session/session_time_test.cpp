#include <algorithm>
#include <string>

#include <gtest/gtest.h>

#include "tests/session/session_rig.hpp"

namespace porttape {
namespace {

using Reason = LineDown::Reason;
using std::chrono::milliseconds;
using std::chrono::minutes;
using std::chrono::seconds;

// How long a session waits, by a clock that is moved, and what its log tells of that.
class SessionTimeTest : public SessionRig {
 protected:
  SessionTimeTest() { start(); }
  void pass(Nanos time) { (void)let_pass(loop, clock, time); }
  bool ends_within(Nanos time) {
    return let_pass(loop, clock, time, [this] { return end_status.has_value(); });
  }
  // The device fails as often, each time for a driver that comes and goes.
  void fail(int times) {
    device.up_at_once = false;
    for (int n = 0; n < times; ++n) {
      driver.up();
      pass(seconds(1));
      device.down(Reason::failed, "no device");
      driver.down(Reason::hung_up);
    }
  }
};

TEST_F(SessionTimeTest, AnEndWaitsForADriverAsLongAsItReads) {
  driver.up();
  driver.congested = true;
  driver.unread = 1000;
  session->stop();
  for (int n = 0; n < 60; ++n) {
    --*driver.unread;
    ASSERT_FALSE(ends_within(seconds(4)));
  }
  EXPECT_FALSE(ends_within(milliseconds(900)));
  EXPECT_TRUE(ends_within(milliseconds(200))) << "five seconds in which it read nothing";
  EXPECT_TRUE(
      told("940 bytes reached nobody (the last because the driver did not read them before the end)"));
}

TEST_F(SessionTimeTest, AnEndWaitsForADeviceAsLongAsItTakesBytes) {
  driver.up();
  device.congested = true;
  device.unread = 1000;
  session->stop();
  for (int n = 0; n < 60; ++n) {
    --*device.unread;
    ASSERT_FALSE(ends_within(seconds(4)));
  }
  EXPECT_TRUE(ends_within(milliseconds(1100)));
}

// A driver that has closed while the device had more than it could take.
TEST_F(SessionTimeTest, AnEndTakesInWhatADriverThatHasClosedLeft) {
  driver.up();
  driver.send("first");
  device.congested = true;
  device.unread = 5;
  driver.left = true;
  driver.reading = false;
  session->stop();
  EXPECT_TRUE(driver.wants_rest());
  for (int n = 0; n < 20; ++n) {
    ASSERT_FALSE(ends_within(seconds(4)));
    ASSERT_FALSE(driver.reading);
    device.unread = 0;
    device.drain();
    ASSERT_TRUE(driver.reading) << n;
    device.congested = true;
    device.unread = 5;
    driver.send("piece");
  }
  EXPECT_EQ(device.written.size(), 5 + 20 * 5);
  driver.left = false;
  driver.down(Reason::closed);
  device.unread = 0;
  device.drain();
  EXPECT_TRUE(ends_within(milliseconds(10)));
  EXPECT_EQ(device.gaps, 0);
}

TEST_F(SessionTimeTest, AnEndGivesUpWhatADriverLeftWhereTheDeviceTakesNothing) {
  driver.up();
  device.congested = true;
  device.unread = 5;
  driver.left = true;
  session->stop();
  EXPECT_FALSE(ends_within(milliseconds(4900)));
  EXPECT_TRUE(ends_within(milliseconds(200)));
}

// Found by seeds of the simulation: it was written to the device, which had more than it could take.
TEST_F(SessionTimeTest, WhatIsGivenUpAtTheEndIsNotWritten) {
  driver.up();
  device.congested = true;
  driver.left = true;
  session->stop();
  device.drain();
  ASSERT_TRUE(driver.reading) << "what the driver left is taken in";
  driver.send("some");
  EXPECT_EQ(device.written, "some");
  device.congested = true;
  driver.pending = [this] { driver.send("late"); };
  EXPECT_FALSE(ends_within(milliseconds(4900)));
  EXPECT_TRUE(ends_within(milliseconds(200)));
  EXPECT_EQ(device.written, "some");
  EXPECT_EQ(device.gaps, 4);
}

TEST_F(SessionTimeTest, AnEndReadsNothingMoreOfADriverThatIsThere) {
  driver.up();
  device.congested = true;
  device.unread = 5;
  session->stop();
  device.unread = 0;
  device.drain();
  driver.send("more");
  EXPECT_EQ(device.written, "");
  EXPECT_NE(driver.calls.find("hang_up_after_reading"), std::string::npos);
}

TEST_F(SessionTimeTest, AnEndTakesInNothingMoreForADeviceThatIsLost) {
  driver.up();
  device.congested = true;
  driver.left = true;
  session->stop();
  device.drain();
  ASSERT_TRUE(driver.reading);
  device.down(Reason::lost, "unplugged");
  driver.send("rest");
  EXPECT_EQ(device.written, "");
  driver.left = false;
  driver.down(Reason::hung_up);
  EXPECT_TRUE(ends_within(milliseconds(10)));
  EXPECT_EQ(device.gaps, 4);
}

TEST_F(SessionTimeTest, ADriversPortIsToldHowMuchTheDeviceHasYetToTake) {
  EXPECT_EQ(driver.unread_by_driver(), std::nullopt);
  driver.up();
  device.unread = 7;
  EXPECT_EQ(driver.unread_by_driver(), 7);
}

TEST_F(SessionTimeTest, WhatEitherTakesIsProgress) {
  driver.up();
  driver.congested = device.congested = true;
  driver.unread = device.unread = 10;
  session->stop();
  for (int n = 0; n < 10; ++n) {
    --*(n % 2 == 0 ? driver : device).unread;
    ASSERT_FALSE(ends_within(seconds(4)));
  }
  EXPECT_TRUE(ends_within(milliseconds(1100)));
}

TEST_F(SessionTimeTest, WhereNobodyKnowsAnEndWaitsFiveSeconds) {
  driver.up();
  driver.congested = true;
  session->stop();
  EXPECT_FALSE(ends_within(milliseconds(4900)));
  EXPECT_TRUE(ends_within(milliseconds(200)));
}

TEST_F(SessionTimeTest, ADeviceThatTakesAllIsNotAskedHowMuchIsLeft) {
  driver.up();
  device.unread = 5;  // in its own buffer, say
  session->stop();
  EXPECT_EQ(driver.calls, "prepare open hang_up_after_reading ");
  EXPECT_FALSE(ends_within(milliseconds(4000)));
  --*device.unread;
  EXPECT_FALSE(ends_within(milliseconds(900)));
  EXPECT_TRUE(ends_within(milliseconds(200))) << "the driver stays, and nothing is known of it";
}

TEST_F(SessionTimeTest, ADriverThatHasGoneIsNotWaitedFor) {
  driver.up();
  driver.unread = 5;
  driver.down(Reason::closed);
  session->stop();
  EXPECT_TRUE(ends_within(Nanos(0)));
  EXPECT_FALSE(told("reached nobody"));
}

TEST_F(SessionTimeTest, WhatIsGivenUpAtTheEndSaysWhichPortsItWas) {
  device.completes = false;
  session->stop();
  EXPECT_FALSE(ends_within(milliseconds(10'499)));
  EXPECT_TRUE(ends_within(milliseconds(1)));
  EXPECT_EQ(end_status, exit_status::kRuntime);
  EXPECT_TRUE(
      told("device and driver: what is to be completed at the end takes too long and is given up; is "
           "the disk there?"))
      << book.text();
}

TEST_F(SessionTimeTest, BothPortsAreReadOnceMoreAtTheEnd) {
  driver.up();
  std::string order;
  driver.pending = [&] { order += "driver "; };
  device.pending = [&] { order += "device "; };
  driver.congested = true;
  session->stop();
  EXPECT_EQ(order, "driver device ");
}

// What the device still sends is for nobody.
TEST_F(SessionTimeTest, ADeviceWhoseDriverHasGoneIsNotReadOnceMoreAtTheEnd) {
  driver.up();
  device.congested = true;
  driver.down(Reason::closed);
  std::string order;
  driver.pending = [&] { order += "driver "; };
  device.pending = [&] { order += "device "; };
  session->stop();
  EXPECT_EQ(order, "driver ") << "one may have come that nothing has told of";
}

TEST_F(SessionTimeTest, ADeviceThatItsDriverHasClosedHasWorked) {
  fail(1);
  device.up_at_once = true;
  driver.up();
  EXPECT_FALSE(told("device: works again")) << "it may die at once";
  driver.down(Reason::closed);
  EXPECT_TRUE(told("device: works again"));
}

TEST_F(SessionTimeTest, ADeviceThatHasFailedOnceIsOpenedAtOnce) {
  fail(1);
  device.calls.clear();
  driver.up();
  EXPECT_EQ(device.calls, "open ");
}

TEST_F(SessionTimeTest, ADeviceThatFailsAgainAndAgainIsOpenedLaterAndLater) {
  device.up_at_once = false;
  Nanos expected{};
  for (int n = 0; n < 12; ++n) {
    driver.up();
    const Instant begin = clock.now();
    ASSERT_TRUE(let_pass(loop, clock, seconds(5), [this] { return device.calls.ends_with("open "); }));
    EXPECT_EQ(clock.now() - begin, expected) << n;
    device.down(Reason::failed, "no device");
    driver.down(Reason::hung_up);
    device.calls.clear();
    if (n > 0) expected = std::min<Nanos>(seconds(1), expected * 2);
    if (n == 0) expected = Nanos(0);
    if (n == 1) expected = milliseconds(10);
  }
}

TEST_F(SessionTimeTest, ADriverThatLeavesWhileItsDeviceIsOpenedLaterOpensNothing) {
  device.up_at_once = false;
  for (int n = 0; n < 6; ++n) {
    driver.up();
    (void)let_pass(loop, clock, seconds(5), [this] { return device.calls.ends_with("open "); });
    device.down(Reason::failed, "no device");
    driver.down(Reason::hung_up);
  }
  driver.up();
  driver.down(Reason::closed);
  device.calls.clear();
  pass(minutes(1));
  EXPECT_EQ(device.calls, "");
}

TEST_F(SessionTimeTest, AnEndThatComesWhileTheDeviceIsOpenedLaterOpensNothing) {
  device.up_at_once = false;
  for (int n = 0; n < 6; ++n) {
    driver.up();
    (void)let_pass(loop, clock, seconds(5), [this] { return device.calls.ends_with("open "); });
    device.down(Reason::failed, "no device");
    driver.down(Reason::hung_up);
  }
  driver.up();
  device.calls.clear();
  driver.congested = true;
  session->stop();
  pass(seconds(2));
  driver.set({.baud = 1200});
  driver.signal({LineSignal::Name::dtr, true});
  driver.flush(FlushQueue::both);
  EXPECT_EQ(device.calls, "");
  EXPECT_TRUE(ends_within(seconds(5)));
}

TEST_F(SessionTimeTest, ATroubleThatRepeatsIsToldOnceAndThenCounted) {
  fail(5);
  const std::string text = book.text();
  EXPECT_EQ(text.find("no device"), text.rfind("no device")) << text;
  driver.up();
  pass(seconds(1));
  device.up();
  device.send("works");
  EXPECT_TRUE(told("device: works again")) << book.text();
  EXPECT_TRUE(told("device: it had failed 4 more times in the same way")) << book.text();
}

TEST_F(SessionTimeTest, ADriversHalfCloseIsPassedOnWhereTheDeviceIsThere) {
  device.up_at_once = false;
  driver.up();
  EXPECT_EQ(driver.end(), PortListener::Answers::none) << "there is nobody to answer";
  device.up();
  EXPECT_EQ(driver.end(), PortListener::Answers::until_hang_up);
}

TEST_F(SessionTimeTest, AnEndLooksAtItsPeersEachFiftyMilliseconds) {
  driver.up();
  driver.congested = true;
  driver.unread = 10;
  session->stop();
  pass(milliseconds(60));
  --*driver.unread;
  EXPECT_FALSE(ends_within(milliseconds(5'030)));
  EXPECT_TRUE(ends_within(milliseconds(20))) << "five seconds after it was seen to read";
}

TEST_F(SessionTimeTest, WhatADriverHasReadAtItsEndIsNoLoss) {
  driver.up();
  driver.congested = true;
  driver.unread = 0;
  session->stop();
  EXPECT_TRUE(ends_within(seconds(6)));
  EXPECT_FALSE(told("reached nobody"));
  EXPECT_EQ(session->counters().dropped_bytes, 0U);
}

TEST_F(SessionTimeTest, WhatThePortsNeverCompleteHasItsLimit) {
  device.completes = false;
  session->stop();
  EXPECT_FALSE(ends_within(milliseconds(10'499)));
  EXPECT_TRUE(ends_within(milliseconds(1)));
  EXPECT_EQ(end_status, exit_status::kRuntime);
}

TEST_F(SessionTimeTest, AfterASecondStopWhatIsNotCompleteHasHalfASecond) {
  device.completes = false;
  session->stop();
  pass(seconds(1));
  session->stop();
  EXPECT_FALSE(ends_within(milliseconds(499)));
  EXPECT_TRUE(ends_within(milliseconds(1)));
  EXPECT_EQ(end_status, exit_status::kRuntime);
}

TEST_F(SessionTimeTest, CountsBytesOpensAndLosses) {
  driver.up();
  driver.send("ask");
  device.send("answer");
  device.down(Reason::lost, "gone");
  driver.down(Reason::hung_up);
  device.send("to nobody");
  const Channel::Counters counters = session->counters();
  EXPECT_EQ(counters.from_driver_bytes, 3U);
  EXPECT_EQ(counters.to_driver_bytes, 6U);
  EXPECT_EQ(counters.opens, 1U);
  EXPECT_EQ(counters.device_losses, 1U);
  EXPECT_EQ(counters.dropped_bytes, 9U);
}

TEST_F(SessionTimeTest, DriversOfADeviceThatFailsAgainAndAgainAreNoNews) {
  driver.up();
  EXPECT_TRUE(told("driver: a driver has opened it"));
  driver.down(Reason::closed);
  EXPECT_TRUE(told("driver: the driver has closed it"));
  fail(1);
  const std::size_t length = book.text().size();
  driver.up();
  driver.down(Reason::closed);
  EXPECT_EQ(book.text().substr(length).find("a driver has opened it"), std::string::npos) << book.text();
}

}  // namespace
}  // namespace porttape
