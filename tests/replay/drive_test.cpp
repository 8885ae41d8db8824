// The tape plays the driver: it writes what is recorded, and what the device sends is compared.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/replay/rig.hpp"

namespace porttape {
namespace {

using test::kSocket;
using test::MemoryTape;
using test::Rig;
using Kind = LineStep::Kind;

constexpr std::int64_t kLinger = 200'000;

ReplayConfig driving(ReplayConfig config = {}) {
  config.writer = Writer::device;
  config.on_mismatch = OnMismatch::fail;
  return config;
}

// For what it does with its line, one by one.
std::vector<Kind> kinds(const Rig& rig) {
  std::vector<Kind> kinds;
  for (const auto& [us, step] : rig.line_steps) kinds.push_back(step.kind);
  return kinds;
}

MemoryTape two_questions() {
  return MemoryTape()
      .open(0)
      .write(1'000, "ask")
      .read(5'000, "answer")
      .write(6'000, "more")
      .read(9'000, "rest")
      .close(500'000);
}

TEST(Drive, WritesAreDueTheRecordedGapAfterTheDevicesAnswer) {
  Rig rig(two_questions(), driving());
  rig.open().until(999);
  EXPECT_EQ(rig.read(), "");
  rig.until(1'000);
  EXPECT_EQ(rig.read(), "ask");
  rig.until(20'000).write("ans").until(40'000).write("wer").until(40'999);
  EXPECT_EQ(rig.read(), "");
  rig.until(41'000);
  EXPECT_EQ(rig.read(), "more");
  rig.write("rest").wait(490'999);
  EXPECT_TRUE(rig.line_steps.empty());
  rig.wait(1);
  EXPECT_EQ(kinds(rig), std::vector{Kind::close});
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->from_driver_matched, 10U);
  EXPECT_EQ(rig.report->to_driver_bytes, 7U);
}

TEST(Drive, AnotherAnswerIsAMismatchAtOnce) {
  Rig rig(two_questions(), driving());
  rig.open().until(1'000).write("anSwer");
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.report->mismatch->offset, 2U);
  EXPECT_EQ(rig.report->mismatch->exchange, 1U);
  EXPECT_TRUE(rig.hung_up);
}

TEST(Drive, UnderWarnTheTapeGoesOn) {
  ReplayConfig config = driving();
  config.on_mismatch = OnMismatch::warn;
  Rig rig(two_questions(), config);
  rig.open().until(1'000).write("anSwer").wait(1'000'000);
  EXPECT_EQ(rig.read(), "askmore");
  rig.write("rest").wait(1'000'000);
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.report->mismatches, 1U);
}

TEST(Drive, ADeviceThatSaysNothingIsWaitedForAndWhatIsMissingIsKnown) {
  Rig rig(two_questions(), driving());
  rig.open().until(1'000).write("answ").until(60'000'000);
  EXPECT_EQ(rig.deadline_us(), std::nullopt);
  const auto unsent = rig.engine.first_unsent();
  ASSERT_TRUE(unsent);
  EXPECT_EQ(as_text(unsent->bytes), "errest");
  EXPECT_EQ(unsent->due - rig.now(), Micros(5'000 - 60'000'000));
  EXPECT_EQ(rig.finish(), Verdict::incomplete);
}

TEST(Drive, AFasterReplayDoesNotHurryTheDevice) {
  ReplayConfig config = driving();
  config.rate = 100;
  Rig rig(two_questions(), config);
  rig.open().until(10);
  EXPECT_EQ(rig.read(), "ask");
  EXPECT_EQ(rig.engine.first_unsent()->due - rig.now(), Micros(4'000));
}

TEST(Drive, WhatIsSaidTooMuchAtTheEndIsExtra) {
  for (const std::int64_t close : {10'000, 1'000'000}) {
    Rig rig(MemoryTape().open(0).write(1'000, "ask").read(5'000, "answer").close(close), driving());
    rig.open().until(1'000).write("answer").wait(std::max(close - 5'000, kLinger) - 1).write("answer");
    rig.wait(2);
    EXPECT_EQ(rig.verdict(), Verdict::extra) << close;
    EXPECT_EQ(as_text(rig.report->mismatch->got), "answer");
    EXPECT_EQ(rig.report->mismatches, 1U);
  }
}

TEST(Drive, ADeviceThatFloodsIsListenedToNoLonger) {
  Rig rig(MemoryTape().open(0).write(1'000, "ask").read(5'000, "answer").close(6'000), driving());
  rig.open().until(1'000).write("answer");
  for (int i = 0; i < 100 && !rig.report; ++i) rig.write(std::string(10'000, 'x')).wait(10'000);
  EXPECT_EQ(rig.verdict(), Verdict::extra);
  EXPECT_LE(rig.now_us(), 1'000 + kLinger + 10'000);
}

TEST(Drive, AStreamThatTheTapeStopsInTheMiddleOfMayGoOn) {
  MemoryTape tape = MemoryTape().open(0).write(1'000, "go");
  for (int i = 1; i <= 5; ++i) tape.read(1'000 + i * 25'000, "scan");
  Rig rig(tape.close(130'000), driving());
  rig.open().until(1'000);
  for (int i = 0; i < 4; ++i) rig.wait(25'000).write("scan");
  rig.wait(25'000).write("scanscansc").wait(10'000);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Drive, ADeviceThatWasSilentBehindAStreamIsHeldToThat) {
  MemoryTape tape = MemoryTape().open(0).write(1'000, "go");
  for (int i = 1; i <= 5; ++i) tape.read(1'000 + i * 25'000, "scan");
  Rig rig(tape.close(900'000), driving());
  rig.open().until(1'000);
  for (int i = 0; i < 6; ++i) rig.wait(25'000).write("scan");
  rig.wait(1'000'000);
  EXPECT_EQ(rig.verdict(), Verdict::extra);
}

TEST(Drive, ATapeWithoutACloseEndsByItself) {
  Rig rig(MemoryTape().write(1'000, "ask").read(5'000, "answer"), driving());
  rig.open().until(1'000).write("answer").wait(kLinger - 1);
  EXPECT_FALSE(rig.report);
  rig.wait(1);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Drive, WritesWithoutAnAnswerAreAllSentBeforeTheEnd) {
  Rig rig(MemoryTape().open(0).write(1'000, "one").write(900'000, "two").close(900'001), driving());
  rig.open().until(900'000);
  EXPECT_EQ(rig.read(), "onetwo");
  rig.wait(kLinger + 1);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Drive, TheDriversReopensAreMadeAndItsSessionsTimedFromThem) {
  Rig rig(MemoryTape()
              .open(0)
              .write(1'000, "a")
              .read(2'000, "A")
              .close(3'000)
              .open(50'000)
              .write(51'000, "b")
              .read(52'000, "B")
              .close(53'000),
          driving());
  rig.open().until(1'000).write("A").until(2'000);
  EXPECT_EQ(kinds(rig), std::vector{Kind::close});
  rig.until(48'999);
  EXPECT_EQ(rig.line_steps.size(), 1U);
  rig.until(49'000);
  EXPECT_EQ(kinds(rig), (std::vector{Kind::close, Kind::open}));
  rig.until(5'000'000);
  EXPECT_EQ(rig.read(), "a") << "nothing is written before the line is there";
  rig.open().wait(1'000);
  EXPECT_EQ(rig.read(), "b");
  rig.write("B").wait(1'000'000);
  EXPECT_EQ(kinds(rig), (std::vector{Kind::close, Kind::open, Kind::close}));
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->sessions_made, 2U);
}

TEST(Drive, WhatTheDeviceSentToNobodyIsNotWaitedFor) {
  Rig rig(MemoryTape()
              .open(0)
              .write(1'000, "a")
              .read(2'000, "A")
              .close(3'000)
              .read(20'000, "unheard")
              .open(50'000)
              .write(51'000, "b")
              .read(52'000, "B")
              .close(53'000),
          driving());
  rig.open().until(1'000).write("A").until(60'000).open().wait(1'000);
  EXPECT_EQ(rig.read(), "ab");
  rig.write("B").wait(1'000'000);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Drive, SettingsAndFlushesOfTheDriverAreMadeInTheirPlace) {
  const SeenSettings fast{.baud = 115'200};
  Rig rig(MemoryTape()
              .open(0)
              .event(0, event::Settings{Side::device, SeenSettings{.baud = 9'600}, std::nullopt})
              .write(1'000, "ask")
              .read(2'000, "ok")
              .event(3'000, event::Settings{Side::driver, fast, SettingsOrder::exact})
              .event(4'000, event::Flush{FlushQueue::in})
              .write(5'000, "go")
              .read(6'000, "fine")
              .close(7'000),
          driving());
  rig.open().until(1'000);
  EXPECT_TRUE(rig.line_steps.empty());
  rig.until(9'000).write("ok").until(11'999);
  ASSERT_EQ(rig.line_steps.size(), 2U);
  EXPECT_EQ(rig.line_steps[0].first, 10'000);
  EXPECT_EQ(std::get<line::Settings>(*rig.line_steps[0].second.event).seen, fast);
  EXPECT_EQ(rig.line_steps[1].first, 11'000);
  EXPECT_EQ(std::get<line::Flush>(*rig.line_steps[1].second.event).queue, FlushQueue::in);
  rig.until(12'000).write("fine").wait(1'000'000);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Drive, SettingsComeBetweenTheWritesThatTheyAreBetweenWithoutDelays) {
  ReplayConfig config = driving();
  config.timing = Timing::none;
  Rig rig(MemoryTape()
              .open(0)
              .write(1'000, "slow")
              .event(2'000, event::Settings{Side::driver, SeenSettings{.baud = 115'200}, std::nullopt})
              .write(3'000, "fast")
              .close(4'000),
          config);
  rig.open();
  ASSERT_EQ(rig.deliveries.size(), 2U);
  EXPECT_EQ(rig.deliveries[0].bytes, "slow");
  EXPECT_EQ(rig.deliveries[1].bytes, "fast");
  EXPECT_EQ(kinds(rig), std::vector{Kind::event});
}

TEST(Drive, TheDriversHalfCloseIsMadeAndTheDevicesIsExpected) {
  const MemoryTape tape = MemoryTape()
                              .open(0)
                              .write(1'000, "ask")
                              .half_close(2'000, Side::driver)
                              .read(3'000, "answer")
                              .half_close(4'000, Side::device)
                              .close(5'000);
  for (const bool ends : {true, false}) {
    Rig rig(tape, driving(), true, std::numeric_limits<std::size_t>::max(), kSocket);
    rig.open().until(1'999);
    EXPECT_FALSE(rig.ended);
    rig.until(2'000);
    EXPECT_TRUE(rig.ended);
    rig.write("answer");
    if (ends) rig.end_writing();
    rig.wait(5'000'000);
    EXPECT_EQ(rig.verdict(), ends ? Verdict::pass : Verdict::incomplete);
    EXPECT_EQ(rig.report->missed_half_close.has_value(), !ends);
  }
}

TEST(Drive, ADeviceThatHangsUpAsRecordedIsAsRecorded) {
  const MemoryTape tape =
      MemoryTape().open(0).write(1'000, "quit").read(3'000, "bye").hang_up(4'000).close(5'000);
  for (const bool ends : {true, false}) {
    Rig rig(tape, driving());
    rig.open().until(1'000).write("bye");
    if (ends) rig.line_ended();
    rig.wait(5'000'000);
    EXPECT_EQ(rig.verdict(), ends ? Verdict::pass : Verdict::incomplete);
    EXPECT_EQ(kinds(rig), ends ? std::vector<Kind>() : std::vector{Kind::close});
  }
}

TEST(Drive, AHangUpOfTheDeviceIsDueAtOnce) {
  Rig rig(two_questions(), driving());
  rig.open().until(1'000);
  EXPECT_EQ(rig.deadline_us(), std::nullopt);
  rig.engine.on_line_ended(rig.now());
  EXPECT_EQ(rig.deadline_us(), rig.now_us());
}

TEST(Drive, ADeviceThatHangsUpEarlierEndsTheRun) {
  Rig rig(two_questions(), driving());
  rig.open().until(1'000).write("answer").line_ended();
  EXPECT_EQ(rig.verdict(), Verdict::incomplete);
}

TEST(Drive, WritesThatNobodyAnswersAreMissedWhereTheDeviceHangsUpBeforeThem) {
  Rig rig(MemoryTape().open(0).write(1'000, "ask").read(5'000, "answer").write(6'000, "off").close(7'000),
          driving());
  rig.open().until(1'000).write("answer").line_ended();
  EXPECT_EQ(rig.verdict(), Verdict::incomplete);
  EXPECT_THAT(to_text(*rig.report), testing::HasSubstr("incomplete: the tape was not played to its end\n"));
}

TEST(Drive, ADeviceMayHangUpWhereTheDriverIsAboutToClose) {
  Rig rig(two_questions(), driving());
  rig.open().until(1'000).write("answer").until(3'000).write("rest").line_ended().wait(1'000'000);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Drive, AnAnswerThatIsLateIsATimingMismatchAtLevelTwo) {
  ReplayConfig config = driving();
  config.strictness = 2;
  for (const std::int64_t late : {99'000, 101'000}) {
    Rig rig(two_questions(), config);
    rig.open().until(5'000 + late).write("answer").wait(1'000).wait(3'000).write("rest").wait(1'000'000);
    EXPECT_EQ(rig.verdict(), late < 100'000 ? Verdict::pass : Verdict::timing_mismatch) << late;
  }
}

TEST(Drive, ByTheRecordedClockWritesDoNotWaitForAnswers) {
  ReplayConfig config = driving();
  config.timing = Timing::recorded;
  Rig rig(two_questions(), config);
  rig.open().until(6'000);
  EXPECT_EQ(rig.read(), "askmore");
  rig.until(20'000).write("answerrest").until(1'000'000);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Drive, AtLevelZeroNothingIsCompared) {
  ReplayConfig config = driving();
  config.strictness = 0;
  Rig rig(two_questions(), config);
  rig.open().wait(2'000).write("?").wait(10'000'000);
  EXPECT_EQ(rig.read(), "askmore");
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Drive, ADeviceThatSaysNothingIsIncompleteAtLevelZeroToo) {
  ReplayConfig config = driving();
  config.strictness = 0;
  Rig rig(two_questions(), config);
  rig.open().wait(10'000'000);
  EXPECT_EQ(rig.read(), "askmore");
  EXPECT_EQ(rig.verdict(), Verdict::incomplete);
}

TEST(Drive, ADeviceThatEndsInTheMiddleIsIncompleteAtLevelZeroToo) {
  ReplayConfig config = driving();
  config.strictness = 0;
  for (const bool by_itself : {true, false}) {
    Rig rig(two_questions(), config);
    rig.open().wait(2'000).write("?");
    EXPECT_EQ(rig.read(), "ask");
    if (by_itself) rig.close();
    EXPECT_EQ(rig.finish_unless_ended(), Verdict::incomplete) << by_itself;
  }
}

TEST(Drive, ALineThatTakesNothingHoldsTheWritesBack) {
  Rig rig(two_questions(), driving());
  rig.blocked(true).open().until(1'000'000);
  EXPECT_EQ(rig.read(), "");
  rig.blocked(false);
  EXPECT_EQ(rig.read(), "ask");
}

TEST(Drive, TheDriversSignalsAreStepsAndTheDevicesAreNone) {
  const MemoryTape tape = MemoryTape()
                              .open(0)
                              .event(100, signal_event({Side::device, {LineSignal::Name::cts, true}}))
                              .event(1'000, signal_event({Side::driver, {LineSignal::Name::dtr, false}}))
                              .event(2'000, signal_event({Side::driver, {LineSignal::Name::brk, true}}))
                              .close(3'000);
  Rig rig(tape, driving());
  rig.open().until(1'999);
  ASSERT_EQ(kinds(rig), std::vector{Kind::event});
  EXPECT_EQ(rig.line_steps[0].first, 1'000);
  EXPECT_EQ(std::get<LineSignal>(*rig.line_steps[0].second.event),
            (LineSignal{LineSignal::Name::dtr, false}));
  rig.until(2'000);
  ASSERT_EQ(kinds(rig).size(), 2U);
  EXPECT_EQ(std::get<LineSignal>(*rig.line_steps[1].second.event), (LineSignal{LineSignal::Name::brk, true}));
}

}  // namespace
}  // namespace porttape
