// Modem lines and breaks on the tape, played to a driver whose line shows them.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/replay/rig.hpp"

namespace porttape {
namespace {

using Name = LineSignal::Name;
using test::MemoryTape;
using test::Rig;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::UnorderedElementsAre;

Event by_device(Name name, bool on) { return signal_event({Side::device, {name, on}}); }
Event by_driver(Name name, bool on) { return signal_event({Side::driver, {name, on}}); }

struct Shown : Rig {
  explicit Shown(const MemoryTape& tape, const ReplayConfig& config = {}) : Rig(tape, config) {
    engine.show_signals(true);
  }
};

MemoryTape answers_and_drops() {
  return MemoryTape()
      .open(0)
      .event(300, by_device(Name::cts, true))
      .write(1'000, "ask")
      .read(3'000, "answer")
      .event(5'000, by_device(Name::cts, false))
      .read(6'000, "rest")
      .close(9'000);
}

TEST(Signals, TheDevicesComeAtTheirTimeAmongTheBytes) {
  Shown rig(answers_and_drops());
  rig.open();
  EXPECT_THAT(rig.signals, ElementsAre("cts on behind 0 at 0")) << "how it stood at the open";
  rig.until(10'000).write("ask").wait(20'000);
  EXPECT_THAT(rig.signals, ElementsAre("cts on behind 0 at 0", "cts off behind 6 at 14000"));
  EXPECT_EQ(rig.delivered, "answerrest");
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_THAT(to_json(*rig.report), HasSubstr(R"("told":{"modem":2})"));
  EXPECT_THAT(to_text(*rig.report), HasSubstr("\n  events    of the device: 2 modem\n"));
}

// Of an idle hour with a signal in its middle each half is one that is too long.
TEST(Signals, TheyAreNoPartOfAnIdleGap) {
  constexpr std::int64_t kHour = 3'600'000'000;
  const MemoryTape tape = MemoryTape()
                              .open(0)
                              .write(1'000, "ask")
                              .read(2'000, "answer")
                              .event(kHour, by_device(Name::cts, false))
                              .event(2 * kHour, by_driver(Name::rts, false))
                              .read(3 * kHour, "rest")
                              .close(3 * kHour + 1'000);
  ReplayConfig config;
  config.max_gap = Micros{50'000};
  Shown rig(tape, config);
  rig.open().write("ask").until(51'000);
  EXPECT_THAT(rig.signals, ElementsAre("cts off behind 6 at 51000"));
  rig.until(80'000).signal(Name::rts, false).until(130'000);
  EXPECT_EQ(rig.delivered, "answerrest");
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Signals, WhereTheTapeIsEnteredTheyStandAsTheyDidThere) {
  const MemoryTape tape = MemoryTape()
                              .open(0)
                              .event(300, by_device(Name::cts, false))
                              .event(400, by_device(Name::cd, true))
                              .event(500, by_device(Name::cts, true))
                              .event(600, by_device(Name::cts, false))
                              .write(1'000, "ask")
                              .read(2'000, "answer")
                              .write(5'000, "again")
                              .read(6'000, "rest")
                              .event(7'000, by_device(Name::cts, true))
                              .close(9'000);
  ReplayConfig config;
  config.start = tape_time_us(4'000);
  Shown rig(tape, config);
  rig.open();
  EXPECT_THAT(rig.signals, UnorderedElementsAre("cts off behind 0 at 0", "cd on behind 0 at 0"));
  rig.until(1'000).write("again").until(9'000);
  EXPECT_EQ(rig.delivered, "rest");
  EXPECT_THAT(rig.signals, Contains("cts on behind 4 at 3000"));
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Signals, WhatTheDriverWasNotToldOfIsNotCounted) {
  Rig rig(answers_and_drops());
  rig.open().write("ask").wait(20'000).close();
  EXPECT_THAT(to_json(*rig.report), HasSubstr(R"("told":{},)"));
  EXPECT_THAT(to_text(*rig.report), Not(HasSubstr("events")));
}

TEST(Signals, ALineThatShowsNoneIsNotHeldUp) {
  Rig rig(answers_and_drops());
  rig.open().write("ask").wait(20'000);
  EXPECT_THAT(rig.signals, IsEmpty());
  EXPECT_EQ(rig.delivered, "answerrest");
}

TEST(Signals, AFlushDropsBytesAndNoSignal) {
  Shown rig(answers_and_drops());
  rig.open().write("ask").blocked(true);
  rig.clock(50'000).engine.on_event(rig.now(), line::Flush{});
  rig.blocked(false);
  EXPECT_EQ(rig.delivered, "");
  EXPECT_THAT(rig.signals, ElementsAre("cts on behind 0 at 0", testing::StartsWith("cts off behind 0")));
}

// A board that greets when DTR is raised.
MemoryTape greets_after_reset() {
  return MemoryTape()
      .open(0)
      .event(1'000, by_driver(Name::dtr, false))
      .event(2'000, by_driver(Name::dtr, true))
      .read(12'000, "hello")
      .close(20'000);
}

TEST(Signals, TheDriversOwnAreGates) {
  Shown rig(greets_after_reset());
  rig.open().until(100'000);
  EXPECT_EQ(rig.delivered, "");
  rig.signal(Name::dtr, false).wait(50'000).signal(Name::dtr, true).wait(9'999);
  EXPECT_EQ(rig.delivered, "");
  rig.wait(1);
  EXPECT_EQ(rig.delivered, "hello");
}

TEST(Signals, AFlushBeforeTheDriversOwnPassesNothingBehindIt) {
  Shown rig(greets_after_reset());
  rig.open().until(100'000);
  rig.flush().wait(1'000);
  rig.signal(Name::dtr, false).signal(Name::dtr, true).flush().wait(9'999);
  EXPECT_EQ(rig.delivered, "");
  rig.wait(1);
  EXPECT_EQ(rig.delivered, "hello");
}

TEST(Signals, OnesOfTheSessionBeforeOpenNoGate) {
  Shown rig(MemoryTape()
                .open(0)
                .write(1'000, "x")
                .read(2'000, "y")
                .event(3'000, by_driver(Name::dtr, false))
                .close(4'000)
                .open(10'000)
                .event(11'000, by_driver(Name::dtr, false))
                .read(21'000, "late")
                .close(40'000));
  rig.open().write("x").wait(1'000);
  EXPECT_EQ(rig.delivered, "y");
  rig.signal(Name::dtr, false).signal(Name::dtr, true).signal(Name::dtr, false).wait(2'000).close();
  rig.wait(100'000).open().wait(50'000);
  EXPECT_EQ(rig.delivered, "y") << "it waits for this session's";
  rig.signal(Name::dtr, false).wait(10'000);
  EXPECT_EQ(rig.delivered, "ylate");
}

TEST(Signals, ByTheRecordedClockTheyHoldNothingUp) {
  ReplayConfig config;
  config.timing = Timing::recorded;
  Shown rig(greets_after_reset(), config);
  rig.open().until(11'999);
  EXPECT_EQ(rig.delivered, "");
  rig.until(12'000);
  EXPECT_EQ(rig.delivered, "hello");
}

TEST(Signals, ByTheRecordedClockTheTapesEndWaitsForTheLastOfThem) {
  ReplayConfig config;
  config.timing = Timing::recorded;
  config.at_end = AtEnd::hangup;
  Shown rig(MemoryTape().open(0).read(1'000, "a").event(5'000, by_driver(Name::dtr, false)), config);
  rig.open().wait(4'999);
  EXPECT_EQ(rig.delivered, "a");
  EXPECT_FALSE(rig.hung_up);
  rig.wait(1);
  EXPECT_TRUE(rig.hung_up);
}

TEST(Signals, ThoseBeforeTheFirstWriteArePlayedToALookup) {
  ReplayConfig config;
  config.match = Match::lookup;
  config.strictness = 1;
  Shown rig(answers_and_drops(), config);
  rig.open().write("ask").wait(20'000);
  EXPECT_THAT(rig.signals, ElementsAre("cts on behind 0 at 0"));
  EXPECT_EQ(rig.delivered, "answerrest");
}

TEST(Signals, OneThatNeverComesIsWaitedForWithPatience) {
  Shown rig(greets_after_reset());
  rig.open().until(5'000'000);
  EXPECT_EQ(rig.delivered, "hello");
}

TEST(Signals, WhatTheDriverDidNotDoIsAMismatchWhereThatIsChecked) {
  ReplayConfig config;
  config.check_settings = true;
  Shown made(greets_after_reset(), config);
  made.open().signal(Name::dtr, false).signal(Name::dtr, true).wait(50'000).close();
  EXPECT_EQ(made.verdict(), Verdict::pass);
  EXPECT_EQ(made.report->settings.recorded, 2);

  Shown not_made(greets_after_reset(), config);
  not_made.open().signal(Name::dtr, false).wait(3'000'000).close();
  EXPECT_EQ(not_made.verdict(), Verdict::settings_mismatch);
  ASSERT_EQ(not_made.report->settings.missing.size(), 1U);
  EXPECT_EQ(to_text(not_made.report->settings.missing.front().what), "dtr on");

  Rig blind(greets_after_reset(), config);
  blind.open().wait(50'000).close();
  EXPECT_EQ(blind.verdict(), Verdict::pass) << "a plain pty shows no signals";
}

// A plug that leads RTS to CTS: the driver may look within its next call.
TEST(Signals, ALineThatFollowsTheDriversDoesSoAtOnce) {
  Shown rig(MemoryTape()
                .open(0)
                .event(10, by_device(Name::cts, true))
                .event(5'000, by_driver(Name::rts, false))
                .event(5'040, by_device(Name::cts, false))
                .event(9'000, by_driver(Name::rts, true))
                .event(9'400, by_device(Name::cts, true))
                .close(20'000));
  rig.open().until(1'000).signal(Name::rts, false);
  EXPECT_THAT(rig.signals, ElementsAre("cts on behind 0 at 0", "cts off behind 0 at 1000"));
  rig.signal(Name::rts, true).wait(399);
  EXPECT_EQ(rig.signals.size(), 2U) << "this one takes a while";
  rig.wait(1);
  EXPECT_EQ(rig.signals.size(), 3U);
}

TEST(Signals, ABreakIsOneOfThem) {
  Shown rig(MemoryTape()
                .open(0)
                .event(1'000, by_driver(Name::brk, true))
                .event(2'000, by_driver(Name::brk, false))
                .event(4'000, by_device(Name::brk, true))
                .read(5'000, "x")
                .close(9'000));
  rig.open().signal(Name::brk, true).wait(1'000).signal(Name::brk, false).wait(10'000);
  EXPECT_THAT(rig.signals, ElementsAre("break on behind 0 at 3000"));
  EXPECT_EQ(rig.delivered, "x");
}

TEST(Signals, ADevicesBreakIsNoneThatTheDriverMade) {
  ReplayConfig config;
  config.check_settings = true;
  Shown rig(MemoryTape()
                .open(0)
                .event(1'000, by_device(Name::brk, true))
                .event(2'000, by_driver(Name::brk, true))
                .event(3'000, by_driver(Name::brk, false))
                .close(9'000),
            config);
  rig.open().wait(3'000'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::settings_mismatch);
  EXPECT_EQ(rig.report->settings.recorded, 2U);
  EXPECT_EQ(rig.report->settings.made, 0U);
}

}  // namespace
}  // namespace porttape
