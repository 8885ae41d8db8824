// The settings that a tape has of its driver, and a run in which the driver makes them, or does not.

#include <gtest/gtest.h>

#include "libport/replay/tape_part.hpp"
#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

SeenSettings baud(unsigned rate) { return {.baud = rate, .stop_bits = 1}; }

Event by(Side side, const SeenSettings& what) { return event::Settings{side, what, SettingsOrder::sampled}; }

// Opens at 9600 baud, asks at 300 and again at 1200.
MemoryTape settings_tape() {
  return MemoryTape()
      .open(0)
      .event(10, by(Side::device, SeenSettings::of({})))
      .event(100'000, by(Side::driver, baud(300)))
      .write(200'000, "ask")
      .read(300'000, "answer")
      .event(400'000, by(Side::driver, baud(1200)))
      .write(500'000, "again")
      .read(600'000, "more")
      .close(700'000);
}

ReplayConfig checking(Timing timing = Timing::reactive) {
  ReplayConfig config;
  config.check_settings = true;
  config.timing = timing;
  return config;
}

// A session with those rates, 0 for none, before each of its writes.
void play(Rig& rig, unsigned first, unsigned second, std::string_view last = "again") {
  rig.open().until(100'000);
  if (first > 0) rig.set(baud(first));
  rig.until(200'000).write("ask").until(400'000);
  if (second > 0) rig.set(baud(second));
  rig.until(500'000).write(last).until(700'000).close();
}

class SettingsTest : public testing::TestWithParam<Timing> {};

TEST_P(SettingsTest, ADriverThatMakesThemAllPasses) {
  Rig rig(settings_tape(), checking(GetParam()));
  play(rig, 300, 1200);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->settings, (SettingsReport{2, 2, {}}));
}

TEST_P(SettingsTest, OneThatLeavesOneOutIsTold) {
  Rig rig(settings_tape(), checking(GetParam()));
  play(rig, 0, 1200);
  EXPECT_EQ(rig.verdict(), Verdict::settings_mismatch);
  EXPECT_EQ(rig.report->settings, (SettingsReport{2, 1, {{tape_time_us(100'000), {baud(300)}}}}));
  EXPECT_FALSE(rig.hung_up);
}

TEST_P(SettingsTest, UncheckedItIsInTheReportAlone) {
  ReplayConfig config = checking(GetParam());
  config.check_settings = false;
  Rig rig(settings_tape(), config);
  play(rig, 300, 0);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->settings, (SettingsReport{2, 1, {{tape_time_us(400'000), {baud(1200)}}}}));
}

TEST_P(SettingsTest, OtherDataOutranksThemAndTheyOutrankWhatIsMissing) {
  Rig other(settings_tape(), checking(GetParam()));
  play(other, 0, 1200, "agaXn");
  EXPECT_EQ(other.verdict(), Verdict::data_mismatch);
  Rig part(settings_tape(), checking(GetParam()));
  play(part, 0, 1200, "aga");
  EXPECT_EQ(part.verdict(), Verdict::settings_mismatch);
}

TEST_P(SettingsTest, WhatComesBehindTheDriversLastWriteDoesNotCountWhileWritesAreMissing) {
  Rig rig(settings_tape(), checking(GetParam()));
  rig.open().until(100'000);
  rig.set(baud(300));
  rig.until(200'000).write("ask").until(450'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::incomplete);
  EXPECT_EQ(rig.report->settings, (SettingsReport{1, 1, {}}));
}

TEST_P(SettingsTest, AtStrictnessZeroTheyAreCheckedAllTheSame) {
  ReplayConfig config = checking(GetParam());
  config.strictness = 0;
  Rig good(settings_tape(), config);
  play(good, 300, 1200, "other");
  EXPECT_EQ(good.verdict(), Verdict::pass);
  Rig rig(settings_tape(), config);
  play(rig, 0, 0, "other");
  EXPECT_EQ(rig.verdict(), Verdict::settings_mismatch);
  EXPECT_EQ(rig.report->settings.missing.size(), 2U);
}

TEST_P(SettingsTest, EachRunHasItsOwn) {
  Rig rig(settings_tape(), checking(GetParam()));
  play(rig, 300, 1200);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  rig.wait(1'000).open().write("ask").wait(400'000).write("again").wait(400'000).close();
  EXPECT_EQ(rig.runs, 2);
  EXPECT_EQ(rig.verdict(), Verdict::settings_mismatch);
}

INSTANTIATE_TEST_SUITE_P(Timings, SettingsTest,
                         testing::Values(Timing::reactive, Timing::recorded, Timing::none));

TEST(Settings, OneBehindTheLastByteIsToBeMadeBeforeTheClose) {
  for (const bool made : {false, true}) {
    Rig rig(MemoryTape().write(0, "ask").read(1'000, "answer").event(2'000, by(Side::driver, baud(300))),
            checking());
    rig.open().write("ask").until(5'000);
    if (made) rig.set(baud(300));
    rig.close();
    EXPECT_EQ(rig.verdict(), made ? Verdict::pass : Verdict::settings_mismatch);
  }
}

TEST(Settings, HoweverManyAreBehindTheLastByteAllCount) {
  MemoryTape tape = MemoryTape().write(0, "ask");
  constexpr unsigned kMany = 10'000;
  for (unsigned n = 1; n <= kMany; ++n) tape.event(n * 100'000, by(Side::driver, baud(n)));
  Rig rig(tape, checking());
  rig.open().write("ask").close();
  EXPECT_EQ(rig.verdict(), Verdict::settings_mismatch);
  EXPECT_EQ(rig.report->settings.recorded, kMany);
  EXPECT_EQ(rig.report->settings.made, 0U);
}

TEST(Settings, ADriverThatIsHungUpAtTheTapesEndMightHaveMadeIt) {
  ReplayConfig config = checking();
  config.at_end = AtEnd::hangup;
  Rig rig(MemoryTape().write(0, "ask").read(1'000, "answer").event(2'000, by(Side::driver, baud(300))),
          config);
  rig.open().write("ask").until(5'000);
  EXPECT_TRUE(rig.hung_up);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Settings, ADriverThatLeavesEarlyHadPerhapsNotComeToOneBeforeAnAnswer) {
  Rig rig(MemoryTape()
              .write(0, "ask")
              .event(100, by(Side::driver, baud(300)))
              .read(1'000, "answer")
              .write(500'000, "more"),
          checking());
  rig.open().write("ask").until(5'000).close();
  EXPECT_EQ(rig.read(), "answer");
  EXPECT_EQ(rig.verdict(), Verdict::incomplete);
  EXPECT_EQ(rig.report->settings.recorded, 0U);
}

// A driver sets its line before it reads, and what it set is seen only after the tape's last bytes have gone.
TEST(Settings, OneThatIsHungUpAtTheTapesEndHadComeToThoseBeforeTheLastBytes) {
  for (const AtEnd at_end : {AtEnd::hangup, AtEnd::exit}) {
    for (const bool made : {false, true}) {
      ReplayConfig config = checking();
      config.at_end = at_end;
      Rig rig(MemoryTape().event(100, by(Side::driver, baud(300))).read(900'000, "stream"), config);
      rig.open().until(1'000'000);
      EXPECT_TRUE(rig.hung_up);
      EXPECT_EQ(rig.runs, 0) << "what the driver set may not have been seen yet";
      EXPECT_FALSE(rig.exits);
      if (made) rig.set(baud(300));
      rig.close();
      EXPECT_EQ(rig.verdict(), made ? Verdict::pass : Verdict::settings_mismatch);
      EXPECT_FALSE(rig.report->closed);
      EXPECT_EQ(rig.exits, at_end == AtEnd::exit);
    }
  }
}

TEST(Settings, OneThatHasMadeThemAllIsJudgedAtTheTapesEnd) {
  ReplayConfig config = checking();
  config.at_end = AtEnd::exit;
  Rig rig(MemoryTape().event(100, by(Side::driver, baud(300))).read(900'000, "stream"), config);
  rig.open().set(baud(300)).until(1'000'000);
  EXPECT_TRUE(rig.exits);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

Event exactly(const SeenSettings& what) { return event::Settings{Side::driver, what, SettingsOrder::exact}; }

// Opens, asks at 300 baud and closes; opens, and asks again at 1200.
MemoryTape two_sessions(Event (*how)(const SeenSettings&)) {
  return MemoryTape()
      .open(0)
      .event(10, by(Side::device, SeenSettings::of({})))
      .event(100'000, how(baud(300)))
      .write(200'000, "ask")
      .read(300'000, "answer")
      .close(400'000)
      .open(500'000)
      .event(600'000, how(baud(1200)))
      .write(700'000, "again")
      .read(800'000, "more")
      .close(900'000);
}

TEST(Settings, ThoseOfAnotherSessionAreNotTheOnesThere) {
  const auto sampled = [](const SeenSettings& what) { return by(Side::driver, what); };
  for (auto* const how : {+exactly, +sampled}) {
    Rig right(two_sessions(how), checking());
    right.open().set(baud(300)).write("ask").wait(200'000).close();
    right.open().set(baud(1200)).write("again").wait(200'000).close();
    EXPECT_EQ(right.verdict(), Verdict::pass);

    Rig early(two_sessions(how), checking());
    early.open().set(baud(300)).set(baud(1200)).write("ask").wait(200'000).close();
    early.open().write("again").wait(200'000).close();
    EXPECT_EQ(early.verdict(), Verdict::settings_mismatch);
    EXPECT_EQ(early.report->settings, (SettingsReport{2, 1, {{tape_time_us(600'000), {baud(1200)}}}}));
  }
}

// Behind the last byte of a session and before the first of the next no byte tells them apart.
TEST(Settings, OneAtTheEndOfASessionIsNotTheOneAtTheBeginOfTheNext) {
  Rig rig(two_sessions(exactly), checking());
  rig.open().set(baud(300)).write("ask").wait(200'000).set(baud(1200)).close();
  rig.open().write("again").wait(200'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::settings_mismatch);
}

TEST(Settings, ADriverThatKeepsItsLineOpenMakesThoseOfAllSessionsInOne) {
  Rig rig(two_sessions(exactly), checking());
  rig.open().set(baud(300)).write("ask").wait(400'000).set(baud(1200)).write("again").wait(400'000).close();
  EXPECT_EQ(rig.report->settings.made, rig.report->settings.recorded);
}

TEST(Settings, OneOnTheOtherSideOfBytesIsNotTheOneThere) {
  Rig rig(two_sessions(exactly), checking());
  rig.open().write("ask").set(baud(300)).wait(200'000).close();
  rig.open().set(baud(1200)).write("again").wait(200'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::settings_mismatch);
  EXPECT_EQ(rig.report->settings, (SettingsReport{2, 1, {{tape_time_us(100'000), {baud(300)}}}}));
}

// Read together with the bytes, nobody knows which of both came first.
TEST(Settings, OneThatWasSeenAmongBytesMayBeOnEitherSideOfThem) {
  for (const bool before : {false, true}) {
    Rig rig(two_sessions(exactly), checking());
    const line::Settings seen{baud(300), SettingsOrder::sampled};
    rig.open();
    if (before) rig.tell(seen);
    rig.write("ask");
    if (!before) rig.tell(seen);
    rig.wait(200'000).close();
    rig.open().set(baud(1200)).write("again").wait(200'000).close();
    EXPECT_EQ(rig.verdict(), Verdict::pass) << before;
  }
}

TEST(Settings, EachRunBeginsAtTheTapesBegin) {
  Rig rig(two_sessions(exactly), checking());
  for (int run = 1; run <= 2; ++run) {
    rig.open().tell(line::Settings{baud(300), SettingsOrder::sampled}).write("ask").wait(200'000).close();
    rig.open().tell(line::Settings{baud(1200), SettingsOrder::sampled}).write("again").wait(200'000).close();
    EXPECT_EQ(rig.runs, run);
    EXPECT_EQ(rig.verdict(), Verdict::pass);
  }
}

// What may be left out or vary has no place that could be compared.
TEST(Settings, WhereWritesAreNotComparedOneByOneAnyPlaceWillDo) {
  ReplayConfig config = checking();
  config.strictness = 0;
  Rig rig(two_sessions(exactly), config);
  rig.open().write("ask").set(baud(300)).set(baud(1200)).wait(200'000).close();
  rig.open().write("again").wait(200'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Settings, TheLineAtTheTapesBeginIsKnownFromOutsideToo) {
  const MemoryTape memory = MemoryTape().open(0).event(1, by(Side::driver, baud(300))).write(100'000, "ask");
  for (const unsigned rate : {300U, 9600U}) {
    MemorySource schedule(memory);
    MemorySource writes(memory, MemorySource::Select::writes_only);
    Engine engine(checking(),
                  {.stamped_at_arrival = true, .opens = 1, .line = SeenSettings::of({.baud = rate})},
                  schedule, writes);
    engine.on_open(Instant{});
    engine.on_write(Instant{}, as_bytes("ask"));
    engine.on_close(Instant{});
    const ReplayActions actions = engine.advance(Instant{});
    ASSERT_TRUE(actions.run_ended);
    EXPECT_EQ(actions.run_ended->verdict, rate == 300 ? Verdict::pass : Verdict::settings_mismatch);
  }
}

TEST(Settings, ThoseBeforeAPartAreNotItsOwn) {
  const MemoryTape memory = settings_tape().open(1'000'000).write(1'100'000, "two").close(1'200'000);
  MemorySource schedule(memory);
  MemorySource writes(memory, MemorySource::Select::writes_only);
  const TapePart part{2, tape_time_us(1'000'000), tape_time_us(1'200'000)};
  PartOfTape schedule_part(schedule, part);
  PartOfTape writes_part(writes, part);
  Engine engine(checking(), {.stamped_at_arrival = true, .opens = 1}, schedule_part, writes_part);
  engine.on_open(Instant{});
  engine.on_write(Instant{}, as_bytes("two"));
  engine.on_close(Instant{});
  const ReplayActions actions = engine.advance(Instant{});
  ASSERT_TRUE(actions.run_ended);
  EXPECT_EQ(actions.run_ended->settings.recorded, 0U);
  EXPECT_EQ(actions.run_ended->verdict, Verdict::pass);
}

}  // namespace
}  // namespace porttape::test
