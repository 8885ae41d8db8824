#include "libport/session/session.hpp"

#include <memory>
#include <optional>

#include <gtest/gtest.h>

#include "tests/support/memory_port.hpp"
#include "tests/support/port_log.hpp"
#include "tests/support/quiet_log.hpp"

namespace porttape {
namespace {

using Reason = LineDown::Reason;

class SessionTest : public testing::Test {
 protected:
  SessionTest() {
    driver.passive = true;
    driver.up_at_once = false;
    session = std::make_unique<Session>(PortContext{&loop, book.log()}, std::make_unique<MemoryPort>(driver),
                                        std::make_unique<MemoryPort>(device),
                                        [this](int status) { end_status = status; });
  }

  // The session with ends that come soon.
  void limit(Session::EndLimits limits) {
    session = std::make_unique<Session>(
        PortContext{&loop, book.log()}, std::make_unique<MemoryPort>(driver),
        std::make_unique<MemoryPort>(device), [this](int status) { end_status = status; }, limits);
  }
  void run_to_end() {
    while (!end_status && loop.run_one()) {
    }
  }

  // A driver has gone, and its last bytes wait for a slow device.
  void leave_last_bytes() {
    start();
    driver.up();
    device.congested = true;
    driver.send("last");
    driver.down(Reason::closed);
  }
  void start() { ASSERT_TRUE(session->start().has_value()); }
  void run_ready() {
    while (loop.poll_one()) {
    }
    loop.restart();
  }

  Loop loop;
  LogBook book;
  MemoryPort::Peer driver;
  MemoryPort::Peer device;
  std::optional<int> end_status;
  std::unique_ptr<Session> session;
};

TEST_F(SessionTest, TheDeviceIsOpenedAndClosedByTheDriver) {
  start();
  EXPECT_EQ(device.calls, "prepare ");
  driver.up();
  EXPECT_EQ(device.calls, "prepare open ");
  driver.down(Reason::closed);
  EXPECT_EQ(device.calls, "prepare open close ");
  driver.up();
  EXPECT_EQ(device.calls, "prepare open close open ");
}

TEST_F(SessionTest, BytesGoBothWays) {
  start();
  driver.up();
  driver.send("ask");
  device.send("answer");
  EXPECT_EQ(device.written, "ask");
  EXPECT_EQ(driver.written, "answer");
  EXPECT_EQ(session->counters().from_driver_bytes, 3U);
  EXPECT_EQ(session->counters().to_driver_bytes, 6U);
}

// A pty shows neither parity nor data bits: those stay as the user gave them.
TEST_F(SessionTest, TheDevicesLineFollowsTheDriversAsFarAsItIsSeen) {
  device.settings = LineSettings{.baud = 9600, .data_bits = 7, .parity = Parity::even};
  start();
  driver.set({.baud = 115200, .hw_flow = true});
  EXPECT_EQ(device.settings,
            (LineSettings{.baud = 115200, .data_bits = 7, .parity = Parity::even, .hw_flow = true}));
}

TEST_F(SessionTest, SignalsGoBothWays) {
  driver.shows_signals = true;
  start();
  driver.up();
  device.calls.clear();
  driver.calls.clear();
  driver.signal({LineSignal::Name::rts, false});
  device.signal({LineSignal::Name::cts, true});
  EXPECT_EQ(device.calls, "rts_off ");
  EXPECT_EQ(driver.calls, "cts_on ");
}

TEST_F(SessionTest, SignalsAreWatchedForADriverThatSeesThem) {
  start();
  driver.up();
  EXPECT_EQ(device.calls.find("watch_signals"), std::string::npos);
  driver.down(Reason::closed);
  driver.shows_signals = true;
  driver.up();
  EXPECT_NE(device.calls.find("watch_signals open "), std::string::npos);
}

TEST_F(SessionTest, WhatADriverDoesBeforeTheDeviceIsThereWaitsForIt) {
  device.up_at_once = false;
  start();
  driver.up();
  device.calls.clear();
  int sent = 0;
  driver.signal({LineSignal::Name::dtr, false});
  driver.wait_until_sent([&sent] { ++sent; });
  EXPECT_EQ(device.calls, "");
  device.up();
  EXPECT_EQ(device.calls, "dtr_off drain ");
  EXPECT_EQ(sent, 0);
  device.drains.at(0)();
  EXPECT_EQ(sent, 1);
}

TEST_F(SessionTest, WhatADriverAsksIsTheDevicesToAnswerOnceItIsThere) {
  int error = 0;
  int answers = 0;
  const TakeAnswer take = [&](const std::optional<LineAnswer>& answer) {
    error = answer ? answer->error : -1;
    ++answers;
  };
  device.up_at_once = false;
  start();
  driver.up();
  device.calls.clear();
  driver.ask(take);
  EXPECT_EQ(device.calls, "");
  device.up();
  EXPECT_EQ(device.calls, "ask ");
  device.questions.at(0)(LineAnswer{.error = 25});
  EXPECT_EQ(error, 25);
  device.down(Reason::lost);
  driver.ask(take);
  EXPECT_EQ(device.calls.find("ask "), device.calls.rfind("ask ")) << "it has no line";
  EXPECT_EQ(error, -1);
  EXPECT_EQ(answers, 2);
}

TEST_F(SessionTest, WhatADriverAskedOfADeviceThatDoesNotComeIsNotItsToAnswer) {
  device.up_at_once = false;
  start();
  driver.up();
  bool asked = false;
  driver.ask([&asked](const std::optional<LineAnswer>& answer) { asked = !answer; });
  EXPECT_FALSE(asked);
  device.down(Reason::failed);
  EXPECT_TRUE(asked);
}

TEST_F(SessionTest, WhatTheNextDriverDoesWaitsUntilTheLastOnesBytesHaveGone) {
  leave_last_bytes();
  driver.shows_signals = true;
  driver.up();
  device.calls.clear();
  driver.signal({LineSignal::Name::rts, false});
  driver.wait_until_sent([] {});
  EXPECT_EQ(device.calls, "");
  device.drain();
  EXPECT_EQ(device.calls, "close watch_signals open rts_off drain ");
}

TEST_F(SessionTest, TheNextDriversFlushIsNotTheLastOnes) {
  leave_last_bytes();
  driver.up();
  device.calls.clear();
  driver.flush(FlushQueue::in);
  EXPECT_EQ(device.calls, "") << "the device still belongs to the last driver";
  device.drain();
  EXPECT_EQ(device.calls, "close open peer_flushed ");
}

TEST_F(SessionTest, ADriverForWhichTheDeviceIsNotOpenedAnyMoreDoesNothingToIt) {
  leave_last_bytes();
  driver.up();
  session->stop();
  device.drain();
  device.calls.clear();
  driver.signal({LineSignal::Name::brk, true});
  driver.set({.baud = 1200});
  driver.flush(FlushQueue::both);
  std::optional<std::optional<LineAnswer>> answer;
  driver.ask([&answer](const std::optional<LineAnswer>& given) { answer = given; });
  EXPECT_TRUE(answer && !*answer);
  EXPECT_EQ(device.calls, "");
}

TEST_F(SessionTest, TheNextDriversFlushIsForgottenWhenItGoes) {
  leave_last_bytes();
  driver.up();
  driver.flush(FlushQueue::in);
  driver.down(Reason::closed);
  driver.up();
  device.calls.clear();
  device.drain();
  EXPECT_EQ(device.calls, "close open ");
}

TEST_F(SessionTest, ADeviceThatIsOpenedLaterIsNotToldOfSettingsBeforeItIsOpen) {
  device.up_at_once = false;
  start();
  for (int failures = 0; failures < 2; ++failures) {
    driver.up();
    device.down(Reason::failed);
    driver.down(Reason::hung_up);
  }
  driver.up();  // the device is opened in a moment, since it has just failed
  device.calls.clear();
  driver.set({.baud = 1200});
  driver.flush(FlushQueue::in);
  EXPECT_EQ(device.calls, "");
  while (device.calls.empty()) loop.run_one();
  EXPECT_EQ(device.calls, "open peer_set peer_flushed ");
}

// One that is kept open may have bytes before, which a tape begins with only when it is opened.
TEST_F(SessionTest, ADeviceThatIsOpenedLaterIsReadOnlyThen) {
  device.up_at_once = false;
  start();
  for (int failures = 0; failures < 2; ++failures) {
    driver.up();
    device.down(Reason::failed);
    driver.down(Reason::hung_up);
  }
  EXPECT_TRUE(device.reading) << "what no driver is there for is counted";
  driver.up();
  EXPECT_FALSE(device.reading);
  device.calls.clear();
  while (device.calls.empty()) loop.run_one();
  EXPECT_EQ(device.calls, "open ");
  device.up();
  EXPECT_TRUE(device.reading);
}

TEST_F(SessionTest, SettingsThatADriverMadeBeforeASignalReachTheDeviceBeforeIt) {
  leave_last_bytes();
  driver.up();
  device.calls.clear();
  driver.set({.baud = 1200});
  driver.signal({LineSignal::Name::dtr, false});
  device.drain();
  EXPECT_EQ(device.calls, "close open peer_set dtr_off ");
}

TEST_F(SessionTest, EarlySignalsAndQuestionsKeepTheirOrder) {
  device.up_at_once = false;
  start();
  driver.up();
  device.calls.clear();
  const TakeAnswer ignore = [](const std::optional<LineAnswer>&) {};
  driver.signal({LineSignal::Name::dtr, false});
  driver.ask(ignore);
  driver.signal({LineSignal::Name::rts, true});
  driver.ask(ignore);
  driver.signal({LineSignal::Name::rts, false});
  device.up();
  EXPECT_EQ(device.calls, "dtr_off ask rts_on ask rts_off ");
}

TEST_F(SessionTest, OfVeryManyEarlySignalsTheLastOfEachIsKept) {
  device.up_at_once = false;
  start();
  driver.up();
  driver.signal({LineSignal::Name::dtr, false});
  for (std::size_t i = 0; i < 10 * WaitingEvents::kMost; ++i)
    driver.signal({LineSignal::Name::rts, i % 2 == 0});
  driver.signal({LineSignal::Name::brk, true});
  device.calls.clear();
  device.up();
  EXPECT_LE(device.calls.size(), (WaitingEvents::kMost + 2) * std::string("rts_off ").size());
  EXPECT_TRUE(device.calls.starts_with("dtr_off rts_"));
  EXPECT_TRUE(device.calls.ends_with("rts_off break_on "));
}

TEST_F(SessionTest, ADeviceThatTellsItsSignalsAsItComesUpIsShownToTheDriver) {
  device.up_at_once = false;
  start();
  driver.up();
  driver.calls.clear();
  device.up();
  device.signal({LineSignal::Name::cd, true});
  EXPECT_EQ(driver.calls, "cd_on ");
  driver.down(Reason::closed);
  driver.calls.clear();
  device.signal({LineSignal::Name::cd, false});
  EXPECT_EQ(driver.calls, "") << "no driver is there";
}

TEST_F(SessionTest, WhatItKnowsNothingOfPassesFromEachSideToTheOther) {
  device.up_at_once = false;
  start();
  driver.up();
  driver.tell(line::Mark{"early"});
  driver.calls.clear();
  device.calls.clear();
  device.up();
  EXPECT_EQ(device.calls, "mark:early ");
  driver.tell(line::Mark{"later"});
  EXPECT_EQ(device.calls, "mark:early mark:later ");
  device.tell(line::Mark{"here"});
  EXPECT_EQ(driver.calls, "mark:here ");
}

TEST_F(SessionTest, OfADeviceNoDriverIsToldWhatADriverAloneAsksFor) {
  start();
  driver.up();
  driver.calls.clear();
  device.tell(line::Flush{});
  device.tell(line::Drain{1});
  device.tell(line::Ask{2, {}});
  EXPECT_EQ(driver.calls, "");
}

TEST_F(SessionTest, ADrainForADeviceThatNeverComesEndsWithTheSession) {
  device.up_at_once = false;
  limit({.without_progress = {}, .completing = std::chrono::hours(1), .failed_step = {}, .at_once = {}});
  start();
  driver.up();
  int sent = 0;
  driver.wait_until_sent([&sent] { ++sent; });
  session->stop();
  run_to_end();
  EXPECT_EQ(sent, 1);
}

TEST_F(SessionTest, ADrainEndsWithTheLine) {
  device.up_at_once = false;
  start();
  driver.up();
  int sent = 0;
  driver.wait_until_sent([&sent] { ++sent; });
  driver.down(Reason::closed);
  EXPECT_EQ(sent, 1);
  driver.wait_until_sent([&sent] { ++sent; });
  EXPECT_EQ(sent, 2) << "there is no device to wait for";
}

TEST_F(SessionTest, TheDriverFindsTheDevicesSettingsAtItsFirstOpen) {
  device.settings = LineSettings{.baud = 4800};
  start();
  EXPECT_EQ(driver.settings, device.settings);
  EXPECT_EQ(driver.calls, "apply prepare open ");
}

TEST_F(SessionTest, SettingsThatTheDeviceDoesNotTakeAreShownAsTheyAre) {
  device.settings = LineSettings{.baud = 4800};
  start();
  driver.settings = LineSettings{.baud = 300};
  device.takes_settings = false;
  driver.set({.baud = 300});
  EXPECT_EQ(device.settings->baud, 4800U);
  EXPECT_EQ(driver.settings, device.settings);
  EXPECT_NE(book.text().find("no such rate"), std::string::npos);
}

TEST_F(SessionTest, ADriverThatComesWhileTheLastOnesBytesGoSetsTheLineOnceTheyHaveGone) {
  device.settings = LineSettings{.baud = 9600};
  start();
  driver.up();
  device.congested = true;
  driver.send("last words");
  driver.down(LineDown::Reason::closed);
  driver.up();
  driver.set({.baud = 300});
  EXPECT_EQ(device.settings->baud, 9600U);
  device.calls.clear();
  device.drain();
  EXPECT_EQ(device.settings->baud, 300U);
  EXPECT_TRUE(device.calls.starts_with("close open ")) << device.calls;
}

TEST_F(SessionTest, ADriverDoesNotWaitForADeviceThatStandsStill) {
  start();
  driver.up();
  device.congested = true;
  device.unread = 10;
  driver.send("last words");
  driver.down(LineDown::Reason::closed);
  driver.up();
  device.calls.clear();
  run_until(loop, [this] { return device.calls.starts_with("close open "); });
  EXPECT_NE(book.text().find("does not take the driver's last bytes"), std::string::npos);
}

TEST_F(SessionTest, ADeviceThatRefusesIsToldOfOnceASession) {
  device.settings = LineSettings{.baud = 4800};
  device.takes_settings = false;
  start();
  const auto told = [this] {
    const std::string text = book.text();
    std::size_t count = 0;
    for (auto at = text.find("no such rate"); at != std::string::npos; at = text.find("no such rate", at + 1))
      ++count;
    return count;
  };
  for (std::size_t round = 1; round <= 2; ++round) {
    driver.up();
    for (unsigned rate = 1; rate < 100; ++rate) driver.set({.baud = rate});
    EXPECT_EQ(told(), round);
    driver.down(LineDown::Reason::closed);
  }
}

TEST_F(SessionTest, ADeviceThatTookOtherSettingsLaterShowsThemToTheDriver) {
  device.settings = LineSettings{.baud = 9600};
  start();
  EXPECT_EQ(driver.settings, device.settings);
  device.settings->baud = 4800;
  device.set({.baud = 4800});
  EXPECT_EQ(driver.settings, device.settings);
}

TEST_F(SessionTest, BytesForAbsentDriverAreCountedAndDropped) {
  start();
  device.send("noise");
  EXPECT_EQ(driver.written, "");
  EXPECT_EQ(session->counters().dropped_bytes, 5U);
}

TEST_F(SessionTest, ASlowDeviceStopsTheDriverUntilItHasDrained) {
  start();
  driver.up();
  device.congested = true;
  driver.send("much");
  EXPECT_FALSE(driver.reading);
  device.drain();
  EXPECT_TRUE(driver.reading);
}

TEST_F(SessionTest, ASlowDriverStopsTheDeviceUntilItHasDrained) {
  start();
  driver.up();
  driver.congested = true;
  device.send("much");
  EXPECT_FALSE(device.reading);
  driver.drain();
  EXPECT_TRUE(device.reading);
}

TEST_F(SessionTest, ADriverThatLeavesASlowDeviceDoesNotStopItForEver) {
  start();
  driver.up();
  driver.congested = true;
  device.send("much");
  driver.down(Reason::closed);
  EXPECT_TRUE(device.reading);
}

TEST_F(SessionTest, LastBytesReachASlowDeviceBeforeItIsClosed) {
  leave_last_bytes();
  EXPECT_EQ(device.calls, "prepare open ");
  device.drain();
  EXPECT_EQ(device.calls, "prepare open close ");
}

TEST_F(SessionTest, ANewDriverWaitsForTheLastOnesBytes) {
  leave_last_bytes();
  driver.up();
  EXPECT_FALSE(driver.reading);
  device.drain();
  EXPECT_EQ(device.calls, "prepare open close open ");
  EXPECT_TRUE(driver.reading);
}

TEST_F(SessionTest, ANewDriverThatIsSlowStopsTheDeviceBeyondTheLastOnesBytes) {
  leave_last_bytes();
  driver.up();
  driver.congested = true;
  device.send("much");
  EXPECT_FALSE(device.reading);
  device.drain();
  EXPECT_EQ(device.calls, "prepare open close open ");
  EXPECT_FALSE(device.reading);
  driver.drain();
  EXPECT_TRUE(device.reading);
}

TEST_F(SessionTest, TheDriverIsNotReadUntilTheDeviceIsUp) {
  device.up_at_once = false;
  start();
  driver.up();
  EXPECT_FALSE(driver.reading);
  device.up();
  EXPECT_TRUE(driver.reading);
}

TEST_F(SessionTest, ALostDeviceHangsUpTheDriverAndSaysWhy) {
  start();
  driver.up();
  device.down(Reason::lost, "unplugged");
  EXPECT_EQ(driver.calls, "prepare open hang_up ");
  EXPECT_NE(book.text().find("unplugged"), std::string::npos);
  driver.down(Reason::hung_up);
  EXPECT_EQ(device.calls, "prepare open close ");
  driver.up();
  EXPECT_EQ(device.calls, "prepare open close open ");
}

TEST_F(SessionTest, APassiveDeviceThatClosesKeepsTheDriverWaiting) {
  device.passive = true;
  start();
  driver.up();
  device.down(Reason::closed);
  EXPECT_EQ(driver.calls, "prepare open ");
  EXPECT_FALSE(driver.reading);
  device.up();
  EXPECT_TRUE(driver.reading);
}

TEST_F(SessionTest, NothingIsOpenedWhenTheDeviceIsMissing) {
  device.prepared = make_error(Errc::device_missing, "no such device");
  const Result<void> started = session->start();
  ASSERT_FALSE(started.has_value());
  EXPECT_EQ(started.error().code, Errc::device_missing);
  EXPECT_EQ(driver.calls, "");
}

TEST_F(SessionTest, StopWithoutADriverEndsAtOnceWithTheDevicesStatus) {
  device.status = exit_status::kIncomplete;
  start();
  session->stop();
  run_ready();
  EXPECT_EQ(end_status, exit_status::kIncomplete);
  EXPECT_EQ(device.calls, "prepare finish ");
}

TEST_F(SessionTest, StopSendsWhatIsQueuedThenHangsUp) {
  start();
  driver.up();
  device.congested = true;
  driver.send("last");
  session->stop();
  EXPECT_EQ(driver.calls, "prepare open ");
  device.drain();
  EXPECT_EQ(driver.calls, "prepare open hang_up_after_reading ");
  driver.down(Reason::hung_up);
  run_ready();
  EXPECT_EQ(end_status, 0);
  EXPECT_EQ(device.calls, "prepare open close finish ");
}

TEST_F(SessionTest, ASecondStopEndsAtOnce) {
  start();
  driver.up();
  device.congested = true;
  driver.send("last");
  session->stop();
  session->stop();
  run_ready();
  EXPECT_EQ(end_status, 0);
}

TEST_F(SessionTest, APortThatHasFinishedEndsTheSessionWithItsStatus) {
  start();
  device.finish(exit_status::kDataMismatch);
  EXPECT_FALSE(end_status.has_value());
  run_ready();
  EXPECT_EQ(end_status, exit_status::kDataMismatch);
}

TEST_F(SessionTest, ADriverThatSendsNoMoreStillGetsItsAnswer) {
  start();
  driver.up();
  driver.send("ask");
  EXPECT_EQ(driver.end(), PortListener::Answers::until_hang_up);
  EXPECT_EQ(device.calls, "prepare open end_writing ");
  device.send("answer");
  EXPECT_EQ(driver.written, "answer");
  device.down(Reason::closed);
  EXPECT_EQ(driver.calls, "prepare open hang_up ");
}

TEST_F(SessionTest, ADriverThatSendsNoMoreIsNotKeptForADeviceThatIsNotThere) {
  device.up_at_once = false;
  start();
  driver.up();
  EXPECT_EQ(driver.end(), PortListener::Answers::none);
}

TEST_F(SessionTest, WhereTheDeviceHasNoHalfCloseQuietEndsTheDriver) {
  device.half_closes = false;
  start();
  driver.up();
  EXPECT_EQ(driver.end(), PortListener::Answers::until_it_is_quiet);
}

TEST_F(SessionTest, ADeviceThatSendsNoMoreIsStillWrittenTo) {
  start();
  driver.up();
  device.send("bye");
  EXPECT_EQ(device.end(), PortListener::Answers::until_hang_up);
  EXPECT_EQ(driver.written, "bye");
  EXPECT_EQ(driver.calls, "prepare open end_writing ");
  driver.send("more");
  EXPECT_EQ(device.written, "more");
  driver.down(Reason::closed);
  EXPECT_EQ(device.calls, "prepare open close ");
}

TEST_F(SessionTest, WhereTheDriversLineHasNoHalfCloseTheDevicesIsItsEnd) {
  driver.half_closes = false;
  start();
  driver.up();
  EXPECT_EQ(device.end(), PortListener::Answers::none);
}

TEST_F(SessionTest, TheDriverIsNotToldThatADeviceSendsNoMoreWhichAnotherOneMayFollow) {
  device.passive = true;
  start();
  driver.up();
  EXPECT_EQ(device.end(), PortListener::Answers::until_it_is_quiet);
  driver.send("answer");
  EXPECT_EQ(device.written, "answer");
  device.down(Reason::closed);
  device.up();
  device.send("another one");
  EXPECT_EQ(driver.written, "another one");
  EXPECT_EQ(driver.calls, "prepare open ");
}

TEST_F(SessionTest, ADeviceThatEndsWithNoDriverThereIsOver) {
  start();
  EXPECT_EQ(device.end(), PortListener::Answers::none);
  EXPECT_EQ(driver.calls, "prepare open ");
}

TEST_F(SessionTest, EachSideIsToldWhetherTheOthersLineHasAHalfClose) {
  driver.half_closes = false;
  start();
  EXPECT_FALSE(device.other_half_closes());
  EXPECT_TRUE(driver.other_half_closes());
}

TEST_F(SessionTest, WhatTheDriversSideDropsIsOneGapASession) {
  start();
  driver.up();
  driver.drop(3);
  driver.drop(4);
  EXPECT_EQ(device.gaps, 0U);
  driver.down(Reason::closed);
  EXPECT_EQ(device.gaps, 7U);
  EXPECT_EQ(session->counters().dropped_bytes, 7U);
  device.drop(5);
  driver.up();
  driver.down(Reason::closed);
  EXPECT_EQ(device.gaps, 7U) << "the device's port notes its own";
  EXPECT_EQ(device.gap_notes, 1);
}

TEST_F(SessionTest, ADriverThatLeavesWhileTheEndWaitsForItsQueueEndsIt) {
  start();
  driver.up();
  driver.congested = true;
  device.finish(exit_status::kIncomplete);
  run_ready();
  EXPECT_FALSE(end_status.has_value());
  driver.congested = false;  // its queue went with it, and no drain is told
  driver.down(Reason::closed);
  run_ready();
  EXPECT_EQ(end_status, exit_status::kIncomplete);
}

TEST_F(SessionTest, WhatHasComeInByTheEndIsPassedOn) {
  start();
  driver.up();
  driver.pending = [this] { driver.send("last"); };
  device.pending = [this] { device.send("answer"); };
  session->stop();
  EXPECT_EQ(device.written, "last");
  EXPECT_EQ(driver.written, "answer");
  EXPECT_EQ(session->counters().dropped_bytes, 0U);
}

TEST_F(SessionTest, ADriverThatGoesWhileTheEndCollectsItsBytesEndsIt) {
  device.completes = false;
  start();
  driver.up();
  driver.pending = [this] {
    driver.send("last");
    driver.down(Reason::closed);
  };
  session->stop();
  EXPECT_EQ(device.written, "last");
  EXPECT_EQ(device.calls, "prepare open close finish ");
  device.complete();
  run_ready();
  EXPECT_EQ(end_status, 0);
}

TEST_F(SessionTest, AtTheEndNothingMoreIsTakenIn) {
  start();
  driver.up();
  device.congested = true;
  driver.send("much");
  EXPECT_FALSE(driver.reading);
  session->stop();
  EXPECT_FALSE(device.reading);
  device.drain();
  EXPECT_FALSE(driver.reading);
  driver.send("late");
  EXPECT_EQ(device.written, "much");
  EXPECT_EQ(session->counters().dropped_bytes, 4U);
}

TEST_F(SessionTest, APortThatPassesOnWhatItShouldNotHaveReadIsToldAndLosesNothing) {
#ifndef NDEBUG
  GTEST_SKIP() << "builds with assertions end there";
#endif
  device.up_at_once = false;
  start();
  driver.up();
  ASSERT_FALSE(driver.reading);
  driver.send("early");
  EXPECT_EQ(device.written, "");
  EXPECT_NE(book.text().find("was not to read"), std::string::npos);
  device.up();
  EXPECT_EQ(device.written, "early");
}

TEST_F(SessionTest, WhatAPortPassedOnAlthoughItWasNotReadIsLostAtAnEndThatComesFirst) {
#ifndef NDEBUG
  GTEST_SKIP() << "builds with assertions end there";
#endif
  start();
  driver.up();
  driver.congested = true;
  device.send("answer");
  ASSERT_FALSE(device.reading);
  device.send("early");
  session->stop();
  session->stop();
  run_ready();
  EXPECT_EQ(driver.written, "answer");
  EXPECT_EQ(session->counters().dropped_bytes, 5U);
  EXPECT_NE(book.text().find("5 bytes reached nobody (the last because the end came before them)"),
            std::string::npos)
      << book.text();
}

TEST_F(SessionTest, AMissingDeviceIsTheEndForADriverThatIsConnectedTo) {
  driver.passive = false;
  driver.up_at_once = true;
  device.up_at_once = false;
  start();
  device.down(Reason::failed);
  driver.down(Reason::hung_up);
  run_ready();
  EXPECT_EQ(end_status, exit_status::kDevice);
}

TEST_F(SessionTest, AnInterruptedDeviceKeepsTheDriverWaiting) {
  start();
  driver.up();
  device.interrupt();
  EXPECT_EQ(driver.calls, "prepare open ");
  EXPECT_FALSE(driver.reading);
  device.resume();
  EXPECT_TRUE(driver.reading);
}

TEST_F(SessionTest, ADriverMayCloseAndOpenWhileTheDeviceIsInterrupted) {
  start();
  driver.up();
  device.interrupt();
  driver.down(Reason::closed);
  device.up_at_once = false;
  driver.up();
  EXPECT_FALSE(driver.reading);
  device.resume();
  device.up();
  EXPECT_TRUE(driver.reading);
}

TEST_F(SessionTest, WhatAPortDroppedIsCountedAndTold) {
  start();
  driver.up();
  device.drop(5);
  driver.down(Reason::closed);
  EXPECT_EQ(session->counters().dropped_bytes, 5U);
  EXPECT_NE(book.text().find("5 bytes reached nobody"), std::string::npos) << book.text();
}

TEST_F(SessionTest, ArrivalsStayApartOnlyWhereTheDriverKeepsDatagrams) {
  start();
  driver.up();
  device.arrive("onetwo", {3, 6});
  EXPECT_EQ(driver.writes, 1);
  driver.datagrams = true;
  device.arrive("onetwo", {3, 6});
  EXPECT_EQ(driver.writes, 3);
}

TEST_F(SessionTest, ADriversPortThatDoesNotWaitForPeersEndsTheSession) {
  driver.passive = false;
  start();
  driver.up();
  driver.down(Reason::lost, "refused");
  run_ready();
  EXPECT_EQ(end_status, exit_status::kDevice);
  EXPECT_NE(book.text().find("refused"), std::string::npos);
}

TEST_F(SessionTest, AnEndGivesUpADriverThatDoesNotReadAndCountsWhatItLeft) {
  limit({.without_progress = std::chrono::milliseconds(1)});
  start();
  driver.up();
  driver.congested = true;
  driver.unread = 7;
  device.finish(exit_status::kPass);
  run_to_end();
  EXPECT_EQ(end_status, exit_status::kPass);
  EXPECT_EQ(session->counters().dropped_bytes, 7U);
  EXPECT_EQ(device.gaps, 7U);
  EXPECT_EQ(driver.calls, "prepare open close finish ") << book.text();
}

TEST_F(SessionTest, AnEndGivesUpADriverThatReadsAllButNeverGoes) {
  limit({.without_progress = std::chrono::milliseconds(1)});
  start();
  driver.up();
  session->stop();
  EXPECT_EQ(driver.calls, "prepare open hang_up_after_reading ");
  run_to_end();
  EXPECT_EQ(end_status, 0);
}

TEST_F(SessionTest, AFailedEndHasItsLimitInAll) {
  limit({.without_progress = std::chrono::hours(1), .failed_step = std::chrono::milliseconds(1)});
  start();
  driver.up();
  driver.congested = true;
  device.completes = false;
  device.finish(exit_status::kRuntime);
  run_to_end();
  EXPECT_EQ(end_status, exit_status::kRuntime);
}

TEST_F(SessionTest, APortThatNeverCompletesIsGivenUpAndTold) {
  limit({.completing = std::chrono::milliseconds(1)});
  device.completes = false;
  start();
  session->stop();
  run_to_end();
  EXPECT_EQ(end_status, exit_status::kRuntime);
  EXPECT_NE(book.text().find("given up"), std::string::npos) << book.text();
  device.complete();  // too late: nothing more comes of it
  run_ready();
  EXPECT_EQ(driver.calls, "prepare open close ");
}

TEST_F(SessionTest, TheDriversPortIsCompletedBehindTheDevices) {
  device.completes = false;
  start();
  session->stop();
  run_ready();
  EXPECT_EQ(driver.calls, "prepare open close ");
  EXPECT_FALSE(end_status.has_value());
  device.complete();
  run_ready();
  EXPECT_EQ(driver.calls, "prepare open close finish ");
  EXPECT_EQ(end_status, 0);
}

TEST_F(SessionTest, ASecondStopDoesNotWaitForADisk) {
  limit({.completing = std::chrono::hours(1), .at_once = std::chrono::milliseconds(1)});
  device.completes = false;
  start();
  session->stop();
  session->stop();
  run_to_end();
  EXPECT_EQ(end_status, exit_status::kRuntime);
}

TEST_F(SessionTest, AStopDuringAnEndOfTheTapesOwnChangesNothing) {
  start();
  driver.up();
  driver.congested = true;
  device.finish(exit_status::kPass);
  run_ready();
  session->stop();
  run_ready();
  EXPECT_FALSE(end_status.has_value());
  driver.down(Reason::closed);
  run_ready();
  EXPECT_EQ(end_status, exit_status::kPass);
}

TEST_F(SessionTest, RotateReachesTheTape) {
  start();
  EXPECT_TRUE(session->request(RecorderRequest::next_tape()));
  EXPECT_EQ(device.calls, "prepare next_tape ");
}

TEST_F(SessionTest, ATraceShowsTheFirstBytesOfEachBlockBothWays) {
  start();
  driver.up();
  driver.send("not traced");
  book.log()->set_level(spdlog::level::trace);
  driver.send("AT\r");
  device.send(std::string(1000, 'x'));
  EXPECT_EQ(book.text().find("not traced"), std::string::npos);
  EXPECT_NE(book.text().find("-> 3 bytes  \"AT\\r\"  41540d\n"), std::string::npos) << book.text();
  EXPECT_NE(book.text().find("<- 1000 bytes  \"" + std::string(32, 'x') + "\"..."), std::string::npos);
}

TEST_F(SessionTest, SaysHowItStands) {
  start();
  EXPECT_EQ(session->state(), Session::State::waiting);
  device.up_at_once = false;
  driver.up();
  EXPECT_EQ(session->state(), Session::State::opening);
  device.up();
  EXPECT_EQ(session->state(), Session::State::open);
  device.interrupt();
  EXPECT_EQ(session->state(), Session::State::interrupted);
  device.resume();
  device.down(Reason::lost);
  EXPECT_EQ(session->state(), Session::State::broken);
  driver.down(Reason::closed);
  EXPECT_EQ(session->state(), Session::State::waiting);
}

int count(const std::string& text, const std::string& what) {
  int found = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++found;
  return found;
}

TEST_F(SessionTest, ADeviceThatFailsForADriverThatComesAgainAndAgainIsToldOnceAndOpenedAtABoundedPace) {
  device.up_at_once = false;
  device.on_open = [this] { loop.post([this] { device.down(Reason::failed, "no such device"); }); };
  start();
  constexpr int kDrivers = 1000;
  for (int n = 0; n < kDrivers; ++n) {
    driver.up();
    run_ready();
    driver.down(device.calls.ends_with("open ") ? Reason::hung_up : Reason::closed);
  }
  EXPECT_EQ(count(book.text(), "no such device"), 1) << book.text();
  EXPECT_EQ(count(book.text(), "a driver has opened it"), 1);
  // The k-th attempt in a row waits for 10 ms * 2^k: few of the drivers stay long enough.
  EXPECT_LT(count(device.calls, "open "), kDrivers / 2);
  EXPECT_EQ(session->counters().opens, static_cast<std::uint64_t>(kDrivers));
}

// A few lines more where the machine stands still for so long that the line seems to have held.
TEST_F(SessionTest, ADeviceThatDiesAsSoonAsItIsOpenIsToldOnce) {
  start();
  for (int n = 0; n < 100; ++n) {
    driver.up();
    if (session->state() == Session::State::open) device.down(Reason::lost, "is lost");
    driver.down(Reason::hung_up);
  }
  EXPECT_GE(count(book.text(), "is lost"), 1);
  EXPECT_LT(count(book.text(), "is lost"), 10) << book.text();
  EXPECT_LT(count(book.text(), "a driver has opened it"), 20);
}

TEST_F(SessionTest, ALineThatIsInterruptedAgainAndAgainIsToldOnce) {
  start();
  driver.up();
  for (int n = 0; n < 100; ++n) {
    device.interrupt();
    device.resume();
  }
  EXPECT_GE(count(book.text(), "waiting for it"), 1);
  EXPECT_LT(count(book.text(), "waiting for it"), 10) << book.text();
  EXPECT_LT(count(book.text(), "is back"), 10);
  device.send("x");
  EXPECT_NE(book.text().find("more times in the same way"), std::string::npos) << book.text();
  EXPECT_EQ(driver.written, "x");
}

TEST_F(SessionTest, BytesThatReachNobodyOfAFailingDeviceAreToldTogether) {
  device.up_at_once = false;
  device.on_open = [this] { loop.post([this] { device.down(Reason::failed, "no such device"); }); };
  start();
  for (int n = 0; n < 6; ++n) {
    driver.calls.clear();
    driver.up();
    run_until(loop, [&] { return driver.calls.ends_with("hang_up "); });
    driver.drop(7);
    driver.down(Reason::hung_up);
    loop.restart();
  }
  session->stop();
  run_to_end();
  EXPECT_LE(count(book.text(), "bytes reached nobody"), 3) << book.text();
  EXPECT_NE(book.text().find("35 bytes reached nobody"), std::string::npos) << book.text();
  EXPECT_EQ(device.gaps, 42U);
}

TEST_F(SessionTest, ADriverThatWaitsGetsADeviceThatHadFailedOnceItIsThere) {
  device.up_at_once = false;
  bool there = false;
  device.on_open = [&] {
    loop.post([&] { there ? device.up() : device.down(Reason::failed, "no such device"); });
  };
  start();
  for (int n = 0; n < 3; ++n) {
    driver.up();
    run_until(loop, [&] { return driver.calls.ends_with("hang_up "); });
    driver.calls.clear();
    driver.down(Reason::hung_up);
  }
  there = true;
  driver.up();
  run_until(loop, [&] { return session->state() == Session::State::open; });
  device.send("hello");
  EXPECT_EQ(driver.written, "hello");
  EXPECT_EQ(count(book.text(), "no such device"), 1) << book.text();
  EXPECT_NE(book.text().find("works again"), std::string::npos);
  EXPECT_NE(book.text().find("it had failed 2 more times"), std::string::npos) << book.text();
}

TEST_F(SessionTest, AnEndDoesNotWaitForADeviceThatIsNotOpenedYet) {
  device.up_at_once = false;
  start();
  driver.up();
  device.down(Reason::failed, "no such device");
  driver.down(Reason::hung_up);
  driver.up();
  device.calls.clear();
  session->stop();
  driver.down(Reason::hung_up);
  run_to_end();
  EXPECT_EQ(device.calls.find("open"), std::string::npos) << device.calls;
}

}  // namespace
}  // namespace porttape
