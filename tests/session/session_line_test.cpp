// What each side's line does, and what the session makes of it for the other side.

#include <cstddef>
#include <fmt/format.h>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/session/session_rig.hpp"

namespace porttape {
namespace {

using Reason = LineDown::Reason;

class SessionLineTest : public SessionRig {
 protected:
  // A driver has gone, its last bytes wait for a slow device, and the next driver is there.
  void wait_behind_last_bytes() {
    start();
    driver.up();
    device.congested = true;
    driver.send("last");
    driver.down(Reason::closed);
    driver.up();
    device.calls.clear();
  }
  void run_ready() {
    while (loop.poll_one()) {
    }
    loop.restart();
  }
};

using Flushes = std::vector<FlushQueue>;

TEST_F(SessionLineTest, AFlushIsPassedOnWithItsQueue) {
  start();
  driver.up();
  for (const FlushQueue queue : {FlushQueue::in, FlushQueue::out, FlushQueue::both}) driver.flush(queue);
  EXPECT_EQ(device.flushes, (Flushes{FlushQueue::in, FlushQueue::out, FlushQueue::both}));
}

TEST_F(SessionLineTest, AnEarlyFlushIsPassedOnOnceTheDeviceIsThere) {
  wait_behind_last_bytes();
  driver.flush(FlushQueue::out);
  driver.flush(FlushQueue::out);
  EXPECT_EQ(device.flushes, Flushes{});
  device.drain();
  EXPECT_EQ(device.flushes, Flushes{FlushQueue::out});
}

TEST_F(SessionLineTest, EarlyFlushesOfEachQueueAreOneOfBoth) {
  wait_behind_last_bytes();
  driver.flush(FlushQueue::in);
  driver.flush(FlushQueue::out);
  device.drain();
  EXPECT_EQ(device.flushes, Flushes{FlushQueue::both});
}

TEST_F(SessionLineTest, AnEarlyFlushOfBothQueuesStaysOne) {
  wait_behind_last_bytes();
  driver.flush(FlushQueue::both);
  driver.flush(FlushQueue::in);
  device.drain();
  EXPECT_EQ(device.flushes, Flushes{FlushQueue::both});
}

TEST_F(SessionLineTest, AFlushForADeviceThatIsClosedIsNone) {
  start();
  driver.flush(FlushQueue::in);
  EXPECT_EQ(device.flushes, Flushes{});
}

TEST_F(SessionLineTest, SettingsArePassedOnWithTheirOrder) {
  start();
  driver.up();
  driver.set({.baud = 300}, SettingsOrder::sampled);
  driver.set({.baud = 300}, SettingsOrder::exact);
  EXPECT_EQ(device.orders, (std::vector{SettingsOrder::sampled, SettingsOrder::exact}));
}

TEST_F(SessionLineTest, OfEarlySettingsTheLastArePassedOnWithTheirOrder) {
  device.settings = LineSettings{.baud = 9600};
  wait_behind_last_bytes();
  driver.set({.baud = 300}, SettingsOrder::sampled);
  driver.set({.baud = 600}, SettingsOrder::exact);
  EXPECT_TRUE(device.orders.empty());
  device.drain();
  EXPECT_EQ(device.orders, std::vector{SettingsOrder::exact});
  EXPECT_EQ(device.settings->baud, 600U);
}

TEST_F(SessionLineTest, EarlySettingsAndFlushesGoWithTheirDriver) {
  device.settings = LineSettings{.baud = 9600};
  wait_behind_last_bytes();
  driver.set({.baud = 300});
  driver.flush(FlushQueue::in);
  driver.down(Reason::closed);
  driver.up();
  device.drain();
  EXPECT_EQ(device.settings->baud, 9600U);
  EXPECT_EQ(device.flushes, Flushes{});
}

TEST_F(SessionLineTest, SettingsThatTheDeviceHasAreNotMadeAgain) {
  device.settings = LineSettings{.baud = 9600};
  start();
  driver.up();
  device.calls.clear();
  driver.set({.baud = 9600});
  EXPECT_EQ(device.calls, "peer_set ");
  driver.set({.baud = 1200});
  EXPECT_EQ(device.calls, "peer_set peer_set apply ");
}

TEST_F(SessionLineTest, SettingsThatTheDeviceRefusesAreNotTheDrivers) {
  device.settings = LineSettings{.baud = 4800};
  device.takes_settings = false;
  start();
  driver.up();
  driver.set({.baud = 300});
  EXPECT_TRUE(told("no such rate; the device keeps its settings"));
  EXPECT_EQ(driver.settings->baud, 4800U) << "the driver is shown them";
}

TEST_F(SessionLineTest, WhyADriverThatDoesNotWaitGoesDecidesTheStatus) {
  struct Case {
    Reason reason;
    int status;
  };
  for (const Case& each :
       {Case{Reason::closed, exit_status::kPass}, Case{Reason::hung_up, exit_status::kPass},
        Case{Reason::failed, exit_status::kDevice}, Case{Reason::lost, exit_status::kDevice}}) {
    driver.passive = false;
    end_status.reset();
    start();
    driver.up();
    driver.down(each.reason, fmt::format("reason {}", static_cast<int>(each.reason)));
    run_ready();
    EXPECT_EQ(end_status, each.status) << static_cast<int>(each.reason);
    EXPECT_EQ(told(fmt::format("reason {}", static_cast<int>(each.reason))),
              each.status != exit_status::kPass);
  }
}

TEST_F(SessionLineTest, HowADriverGoesIsTold) {
  start();
  driver.up();
  driver.down(Reason::closed);
  EXPECT_TRUE(told("driver: the driver has closed it"));
  EXPECT_FALSE(told("driver: hung up"));
  driver.up();
  driver.down(Reason::hung_up);
  EXPECT_TRUE(told("driver: hung up"));
}

TEST_F(SessionLineTest, HowADeviceGoesIsToldAndOnlyATroubleIsALoss) {
  start();
  const auto losses_after = [this](Reason reason) {
    driver.up();
    device.down(reason, "unplugged");
    driver.down(Reason::hung_up);
    return session->counters().device_losses;
  };
  EXPECT_EQ(losses_after(Reason::closed), 0U);
  EXPECT_TRUE(told("device: closed by the device"));
  EXPECT_FALSE(told("device: hangs up"));
  EXPECT_EQ(losses_after(Reason::hung_up), 0U);
  EXPECT_TRUE(told("device: hangs up"));
  EXPECT_FALSE(told("unplugged"));
  EXPECT_EQ(losses_after(Reason::lost), 1U);
  EXPECT_TRUE(told("unplugged"));
  EXPECT_EQ(losses_after(Reason::failed), 2U);
}

TEST_F(SessionLineTest, AHangUpOfTheDeviceIsTheDriversBehindWhatItHasToRead) {
  start();
  driver.up();
  device.hang_up(true);
  EXPECT_EQ(driver.calls, "prepare open hang_up_after_reading ");
  driver.down(Reason::hung_up);
  driver.up();
  device.hang_up(false);
  EXPECT_EQ(driver.calls, "prepare open hang_up_after_reading hang_up ");
}

TEST_F(SessionLineTest, SignalsOfTheDeviceAreForADriverThatIsThere) {
  start();
  const LineSignal dsr{LineSignal::Name::dsr, true};
  driver.up();
  device.signal(dsr);
  EXPECT_EQ(driver.calls, "prepare open dsr_on ");
  driver.down(Reason::closed);
  device.signal(dsr);
  EXPECT_EQ(driver.calls, "prepare open dsr_on ");
}

TEST_F(SessionLineTest, WhatWasWrittenForADeviceThatIsAwayIsDroppedWithTheReason) {
  device.up_at_once = false;
  start();
  driver.up();
  driver.pending = [this] { driver.send("four"); };
  session->stop();
  run_ready();
  driver.down(Reason::hung_up);
  run_ready();
  EXPECT_EQ(session->counters().dropped_bytes, 4U);
  EXPECT_EQ(session->counters().from_driver_bytes, 0U);
  EXPECT_EQ(device.gaps, 4U);
  EXPECT_EQ(device.gap_why, "the device was not there to take them");
}

TEST_F(SessionLineTest, WhatComesAfterTheEndIsDroppedWithTheReason) {
  start();
  driver.up();
  device.congested = true;
  session->stop();
  driver.send("late");
  device.drain();
  driver.down(Reason::hung_up);
  run_ready();
  EXPECT_EQ(device.written, "");
  EXPECT_EQ(session->counters().dropped_bytes, 4U);
  EXPECT_EQ(device.gap_why, "they came after the end");
}

TEST_F(SessionLineTest, TheDeviceIsToldHowMuchTheDriverHasNotRead) {
  start();
  driver.unread = 9;
  EXPECT_EQ(device.unread_by_driver(), std::optional<std::size_t>(0)) << "nobody is there";
  driver.up();
  EXPECT_EQ(device.unread_by_driver(), std::optional<std::size_t>(9));
  driver.unread.reset();
  EXPECT_EQ(device.unread_by_driver(), std::nullopt);
}

TEST_F(SessionLineTest, ADeviceThatWaitsForItsNextPeerKeepsTheDriver) {
  device.passive = true;
  start();
  driver.up();
  device.down(Reason::closed);
  EXPECT_FALSE(driver.reading);
  EXPECT_EQ(session->state(), Session::State::opening);
  EXPECT_EQ(driver.calls, "prepare open ");
  device.up();
  EXPECT_TRUE(driver.reading);
  EXPECT_EQ(session->state(), Session::State::open);
}

TEST_F(SessionLineTest, TheStatusOfTheDevicesEndCountsWhereNothingElseHasOne) {
  device.status = exit_status::kDataMismatch;
  start();
  session->stop();
  run_ready();
  EXPECT_EQ(end_status, exit_status::kDataMismatch);
  end_status.reset();
  device.status = exit_status::kDataMismatch;
  start();
  driver.finish(exit_status::kIncomplete);
  run_ready();
  EXPECT_EQ(end_status, exit_status::kIncomplete) << "what ended it counts";
}

TEST_F(SessionLineTest, ADriverInterruptedStopsTheDeviceUntilItGoes) {
  start();
  driver.up();
  driver.interrupt();
  EXPECT_FALSE(device.reading);
  device.drain();
  EXPECT_FALSE(device.reading);
  driver.down(Reason::closed);
  driver.up();
  EXPECT_TRUE(device.reading);
}

}  // namespace
}  // namespace porttape
