// What of a tape is played, and how often: start, end, preroll, loops, gaps that are cut.

#include <gtest/gtest.h>

#include "libport/replay/gap_cuts.hpp"
#include "libport/replay/tape_part.hpp"
#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

using Deliveries = std::vector<Rig::Delivery>;

ReplayConfig from(std::int64_t us) {
  ReplayConfig config;
  config.on_mismatch = OnMismatch::fail;
  config.start = tape_time_us(us);
  return config;
}

ReplayConfig looped(std::uint64_t loops) {
  ReplayConfig config;
  config.on_mismatch = OnMismatch::fail;
  config.loops = loops;
  return config;
}

ReplayConfig at_recorded_times(ReplayConfig config) {
  config.timing = Timing::recorded;
  return config;
}

ReplayConfig timed(ReplayConfig config) {
  config.strictness = 2;
  config.jitter = Micros{5'000};
  return config;
}

const MemoryTape& three_polls() {
  static const MemoryTape tape = MemoryTape()
                                     .write(1'000, "a?")
                                     .read(2'000, "A")
                                     .write(11'000, "b?")
                                     .read(12'000, "B")
                                     .write(21'000, "c?")
                                     .read(23'000, "C");
  return tape;
}

TEST(Start, WhatIsBeforeItIsNotExpected) {
  Rig rig(three_polls(), from(11'000));
  rig.open().wait(500).write("b?").wait(5'000).write("c?").wait(5'000);
  EXPECT_EQ(rig.deliveries, (Deliveries{{1'500, "B", {1}}, {7'500, "C", {1}}}));
  EXPECT_EQ(rig.finish(), Verdict::pass);
  EXPECT_EQ(rig.report->from_driver_matched, 4U);
}

TEST(Start, AWriteOfBeforeItIsADifferenceAndTheReportHasTheTapesTime) {
  Rig rig(three_polls(), from(11'000));
  rig.open().write("a?");
  ASSERT_TRUE(rig.report);
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.report->mismatch->tape, tape_time_us(11'000));
  EXPECT_EQ(rig.report->mismatch->tape_offset, 2U);
}

TEST(Start, AStreamComesFromThereOn) {
  const auto tape = MemoryTape().open(0).read(1'000, "a").read(5'000, "b").read(9'000, "c");
  for (const ReplayConfig& config : {from(4'000), at_recorded_times(from(4'000))}) {
    Rig rig(tape, config);
    rig.open().until(20'000);
    EXPECT_EQ(rig.deliveries, (Deliveries{{1'000, "b", {1}}, {5'000, "c", {1}}}));
  }
}

TEST(Start, BetweenTwoSessionsItIsTheNextOnesBegin) {
  const auto tape =
      MemoryTape().open(0).read(1'000, "a").close(2'000).open(50'000).read(51'000, "b").close(60'000);
  Rig rig(tape, from(10'000));
  rig.open().until(20'000);
  EXPECT_EQ(rig.deliveries, (Deliveries{{1'000, "b", {1}}}));
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Start, SettingsOfBeforeItAreNotExpected) {
  const auto settings = [](std::uint32_t baud) {
    return event::Settings{.by = Side::driver, .line = {.baud = baud}, .order = SettingsOrder::exact};
  };
  ReplayConfig config = from(100'000);
  config.check_settings = true;
  const auto tape = MemoryTape()
                        .event(1'000, settings(1200))
                        .write(90'000, "x")
                        .read(91'000, "y")
                        .write(101'000, "a")
                        .read(102'000, "A")
                        .event(110'000, settings(300))
                        .write(200'000, "b")
                        .read(201'000, "B");
  Rig rig(tape, config);
  rig.open().write("a").wait(2'000).set({.baud = 300}).write("b").wait(2'000);
  EXPECT_EQ(rig.finish(), Verdict::pass);
  EXPECT_EQ(rig.report->settings.recorded, 1U);
}

TEST(End, IsTheTapesEndForBothDirections) {
  const TapePart part{.until = tape_time_us(21'000)};
  MemorySource merged(three_polls());
  MemorySource writes_alone(three_polls(), MemorySource::Select::writes_only);
  PartOfTape schedule(merged, part);
  PartOfTape writes(writes_alone, part);
  Engine engine({}, {}, schedule, writes);
  const Instant now{Micros{1}};
  engine.on_open(now);
  engine.on_write(now, as_bytes("a?b?"));
  (void)engine.advance(now + Micros{10'000});
  engine.finish(now);
  const auto ended = engine.advance(now + Micros{100'000});
  ASSERT_TRUE(ended.run_ended);
  EXPECT_EQ(ended.run_ended->verdict, Verdict::pass);
}

TEST(End, EventsBehindItAreNotThere) {
  const auto tape = MemoryTape().open(0).read(10, "a").close(20).open(30).read(40, "b");
  MemorySource merged(tape);
  PartOfTape part(merged, {.until = tape_time_us(30)});
  int records = 0;
  while (part.next()->has_value()) ++records;
  EXPECT_EQ(records, 3);
}

const MemoryTape& greeting() {
  static const MemoryTape tape = MemoryTape()
                                     .open(0)
                                     .write(100'000, "hello")
                                     .read(400'000, "hi")
                                     .write(500'000, "go")
                                     .read(900'000, "ok")
                                     .read(5'000'000, "1")
                                     .read(6'000'000, "2")
                                     .read(7'000'000, "3");
  return tape;
}

TEST(Preroll, TheHandshakeComesFirstAndWithoutWaiting) {
  ReplayConfig config = from(5'500'000);
  config.preroll = true;
  for (const ReplayConfig& each : {config, at_recorded_times(config), timed(config)}) {
    Rig rig(greeting(), each);
    rig.open().wait(10'000).write("hello").wait(10'000).write("go").until(3'000'000);
    EXPECT_EQ(
        rig.deliveries,
        (Deliveries{{10'000, "hi", {2}}, {20'000, "ok", {2}}, {520'000, "2", {1}}, {1'520'000, "3", {1}}}));
    EXPECT_EQ(rig.finish(), Verdict::pass);
    EXPECT_EQ(rig.report->playback.prerolled, (TapeTotals{4, 7}));
  }
}

TEST(Preroll, AHandshakeThatDiffersIsAMismatch) {
  ReplayConfig config = from(5'500'000);
  config.preroll = true;
  Rig rig(greeting(), config);
  rig.open().write("hallo");
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
}

TEST(Preroll, WithoutItTheHandshakeIsNotExpected) {
  Rig rig(greeting(), from(5'500'000));
  rig.open().until(2'000'000);
  EXPECT_EQ(rig.deliveries, (Deliveries{{500'000, "2", {1}}, {1'500'000, "3", {1}}}));
  EXPECT_EQ(rig.finish(), Verdict::pass);
}

TEST(Preroll, EndsWithTheDriversFirstPauseThoughTheDeviceSpeaksOn) {
  auto tape = MemoryTape().open(0).write(10'000, "start");
  for (int n = 0; n < 40; ++n) tape.read(100'000 * (n + 1), std::string(1, static_cast<char>('A' + n)));
  ReplayConfig config = from(3'000'000);
  config.preroll = true;
  Rig rig(tape, config);
  rig.open().write("start").until(150'000);
  EXPECT_EQ(rig.read(), "ABCDEFGHIJ^_");
}

TEST(Preroll, ASlowAnswerIsOfTheHandshake) {
  const auto tape = MemoryTape().open(0).write(0, "slow").read(1'800'000, "!").read(9'000'000, "z");
  ReplayConfig config = from(8'000'000);
  config.preroll = true;
  Rig rig(tape, config);
  rig.open().wait(100).write("slow").until(2'000'000);
  EXPECT_EQ(rig.deliveries, (Deliveries{{100, "!", {1}}, {1'000'100, "z", {1}}}));
}

TEST(Preroll, WhatComesAheadOfItsEndIsComparedOnceItIsOver) {
  const auto tape =
      MemoryTape().open(0).write(0, "hi").read(10'000, "H").write(6'000'000, "q").read(6'100'000, "Q");
  ReplayConfig config = from(5'500'000);
  config.preroll = true;
  config.loops = 2;
  Rig rig(tape, config);
  rig.open().write("hiqx").wait(1'000'000);
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.report->mismatch->offset, 3U);
}

TEST(Loops, SoManyAreOneRun) {
  Rig rig(three_polls(), looped(3));
  rig.open();
  for (int n = 0; n < 3; ++n) {
    rig.wait(10'000).write("a?").wait(2'000).write("b?").wait(2'000).write("c?").wait(3'000);
  }
  EXPECT_EQ(rig.delivered, "ABCABCABC");
  EXPECT_EQ(rig.runs, 0);
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->playback.loops_complete, 3U);
  EXPECT_EQ(rig.report->from_driver_matched, 18U);
  EXPECT_EQ(rig.report->from_driver_of, 18U);
  EXPECT_EQ(rig.report->to_driver_of, 9U);
}

TEST(Loops, TooFewAreIncompleteAndOneMoreIsExtra) {
  Rig few(three_polls(), looped(2));
  few.open().write("a?b?c?").wait(50'000).write("a?b?").wait(50'000);
  EXPECT_EQ(few.finish(), Verdict::incomplete);
  EXPECT_EQ(few.report->playback.loops_complete, 1U);
  Rig many(three_polls(), looped(2));
  many.open().write("a?b?c?").wait(50'000).write("a?b?c?").wait(50'000).write("a?");
  EXPECT_EQ(many.verdict(), Verdict::extra);
}

// A driver may write ahead, beyond a loop's end too.
TEST(Loops, WhatComesBehindTheEndOfOneBelongsToTheNext) {
  for (const Timing timing : {Timing::reactive, Timing::none, Timing::recorded}) {
    ReplayConfig config = looped(3);
    config.timing = timing;
    Rig rig(three_polls(), config);
    rig.open().write("a?b?c?a?b?c?a?b?c?").wait(200'000).close();
    EXPECT_EQ(rig.verdict(), Verdict::pass);
    EXPECT_EQ(rig.delivered, "ABCABCABC");
    EXPECT_EQ(rig.report->playback.loops_complete, 3U);
  }
}

TEST(Loops, WhatEndsWithAWriteGoesOnAtOnce) {
  const auto tape = MemoryTape().write(100, "a").read(200, "A").write(60'000, "b");
  Rig rig(tape, looped(2));
  rig.open().write("a").wait(1'000).write("b").write("a").wait(100'000).write("b").close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.read(), "AA");
}

TEST(Loops, AWrongByteOfTheNextIsADifferenceOfThat) {
  Rig rig(three_polls(), looped(2));
  rig.open().write("a?b?c?x").wait(100'000);
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.report->mismatch->offset, 6U);
  EXPECT_EQ(rig.report->mismatch->tape_offset, 0U);
}

TEST(Loops, WhatIsBeyondTheLastIsExtraHoweverFarAheadItCame) {
  Rig rig(three_polls(), looped(2));
  rig.open().write("a?b?c?a?b?c?a").wait(100'000);
  EXPECT_EQ(rig.verdict(), Verdict::extra);
  Rig closed(three_polls(), looped(2));
  closed.open().write("a?b?c?a?b?c?a").close();
  EXPECT_EQ(closed.verdict(), Verdict::extra);
}

TEST(Loops, ACloseDoesNotWaitForTheNextOne) {
  Rig rig(three_polls(), looped(2));
  rig.open().write("a?b?c?a?b?c?").close();
  EXPECT_EQ(rig.runs, 1);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  Rig some(three_polls(), looped(3));
  some.open().write("a?b?c?a?b?c?");
  EXPECT_EQ(some.finish(), Verdict::incomplete);
  Rig endless(three_polls(), looped(0));
  endless.open().write("a?b?c?a?b?c?a?").close();
  EXPECT_EQ(endless.verdict(), Verdict::pass);
}

TEST(Loops, AnOpenOfALineThatIsOpenDoesNotKeepTheNextOneFromBeginning) {
  Rig rig(three_polls(), looped(2));
  rig.open().write("a?b?c?a?b?c?").open().wait(200'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.delivered, "ABCABC");
}

TEST(Loops, ATapeWithoutWritesExpectsNoneInAny) {
  Rig rig(MemoryTape().read(1'000, "a"), looped(0));
  rig.open().write("x");
  EXPECT_EQ(rig.verdict(), Verdict::extra);
}

TEST(Loops, TheFirstWriteOfAFurtherOneIsTimedFromItsBegin) {
  const auto verdict = [](std::int64_t first, std::int64_t second) {
    Rig rig(MemoryTape().open(0).write(20'000, "a").read(30'000, "A"), timed(looped(2)));
    rig.open().wait(first).write("a").wait(10'000).wait(second).write("a").wait(10'000).close();
    return rig.verdict();
  };
  EXPECT_EQ(verdict(20'000, 20'000), Verdict::pass);
  EXPECT_EQ(verdict(20'000, 3'000'000), Verdict::timing_mismatch);
  EXPECT_EQ(verdict(3'000'000, 20'000), Verdict::timing_mismatch);
}

TEST(Loops, TheFirstWriteBehindAStartHasNoTimeInAny) {
  ReplayConfig config = timed(looped(2));
  config.start = tape_time_us(15'000);
  Rig rig(MemoryTape().open(0).write(20'000, "a").read(30'000, "A"), config);
  rig.open().wait(900'000).write("a").wait(910'000).write("a").wait(10'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Loops, ADifferenceInAnyIsOne) {
  Rig rig(three_polls(), looped(0));
  rig.open().write("a?b?c?").wait(50'000).write("a?x?");
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
}

TEST(Loops, ForEverTheFirstMustBeComplete) {
  Rig some(three_polls(), looped(0));
  some.open().write("a?b?").wait(50'000).close();
  EXPECT_EQ(some.verdict(), Verdict::incomplete);
  Rig rig(three_polls(), looped(0));
  rig.open();
  for (int n = 0; n < 50; ++n) rig.write("a?b?c?").wait(50'000);
  rig.write("a?").wait(5'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->playback.loops, 51U);
  EXPECT_EQ(rig.report->playback.loops_complete, 50U);
  EXPECT_EQ(rig.report->playback.loops_of, std::nullopt);
}

TEST(Loops, AStreamHasNoDrift) {
  const auto tape = MemoryTape().read(0, "a").read(333'333, "b").close(1'000'003);
  ReplayConfig config = at_recorded_times(looped(0));
  config.rate = 3;
  Rig rig(tape, config);
  rig.open();
  rig.stall(700'000);  // what comes late moves nothing
  rig.until(3'600'000'000);
  ASSERT_GT(rig.deliveries.size(), 20'000U);
  const auto& last = rig.deliveries[20'000];  // "a" and "b" of the first that were late are one
  const std::int64_t loop = 1'000'003LL * 10'001 / 3;
  EXPECT_NEAR(static_cast<double>(last.us), static_cast<double>(loop), 333'334.0);
  for (std::size_t n = 10; n < rig.deliveries.size(); ++n) {
    if (rig.deliveries[n].bytes != "a") continue;
    const std::int64_t over = (rig.deliveries[n].us * 3) % 1'000'003;
    EXPECT_TRUE(over < 40'000 || over > 1'000'000) << over << " at " << rig.deliveries[n].us;
  }
}

TEST(Loops, APartIsLooped) {
  ReplayConfig config = at_recorded_times(looped(0));
  config.start = tape_time_us(1'000);
  config.end = tape_time_us(4'000);
  const auto tape = MemoryTape().open(0).read(500, "x").read(2'000, "a").read(3'000, "b");
  Rig rig(tape, config);
  rig.open().until(8'000);
  EXPECT_EQ(rig.deliveries, (Deliveries{{1'000, "a", {1}},
                                        {2'000, "b", {1}},
                                        {4'000, "a", {1}},
                                        {5'000, "b", {1}},
                                        {7'000, "a", {1}},
                                        {8'000, "b", {1}}}));
}

TEST(Loops, AReopenBetweenThemIsOfTheRun) {
  const auto tape = MemoryTape().open(0).write(100, "a").read(200, "A").close(300);
  Rig rig(tape, looped(3));
  for (int n = 0; n < 3; ++n) {
    EXPECT_EQ(rig.runs, 0);
    rig.open().write("a").wait(1'000).close().wait(1'000);
  }
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.delivered, "AAA");
  EXPECT_EQ(rig.report->playback.loops_complete, 3U);
}

TEST(Loops, ForADriverThatIsFasterThanTheRecordedOneTheNextBeginsEarlier) {
  const auto tape = MemoryTape().write(100, "a").read(200, "A").write(60'000'000, "b");
  Rig rig(tape, looped(3));
  rig.open();
  for (int n = 0; n < 3; ++n) rig.write("a").wait(1'000).write("b").wait(10'000);
  EXPECT_EQ(rig.read(), "AAA");
  Rig other(MemoryTape().write(100, "a").read(200, "A").event(60'000'000, event::Mark{"m"}), looped(3));
  other.open();
  for (int n = 0; n < 3; ++n) other.write("a").wait(10'000);
  EXPECT_EQ(other.read(), "AAA");
}

TEST(Loops, ForEverACloseAtTheEndOfOneEndsTheRun) {
  const auto tape = MemoryTape().open(0).write(100, "a").read(200, "A").close(300);
  Rig rig(tape, looped(0));
  rig.open().write("a").wait(5'000).close();
  EXPECT_EQ(rig.runs, 1);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Loops, OfATapeWithoutTimeLeaveTimeToOthers) {
  for (const auto& tape : {MemoryTape().read(0, "a"), MemoryTape()}) {
    Rig rig(tape, looped(0));
    rig.open().until(1'000'000);
    EXPECT_LE(rig.delivered.size(), 1'001U);
    EXPECT_EQ(rig.delivered.size(), tape.entries().empty() ? 0U : 1'001U);
  }
}

TEST(Loops, WhatFollowsTheLastIsAtEnds) {
  ReplayConfig config = looped(2);
  config.at_end = AtEnd::hangup;
  Rig rig(MemoryTape().read(1'000, "a"), config);
  rig.open().until(1'500);
  EXPECT_FALSE(rig.hung_up);
  rig.until(10'000);
  EXPECT_TRUE(rig.hung_up);
  EXPECT_EQ(rig.delivered, "aa");
}

TEST(Loops, SettingsAreExpectedOnce) {
  ReplayConfig config = looped(3);
  config.check_settings = true;
  const auto tape =
      MemoryTape()
          .open(0)
          .event(10,
                 event::Settings{.by = Side::driver, .line = {.baud = 300}, .order = SettingsOrder::exact})
          .write(100'000, "a")
          .read(101'000, "A");
  Rig rig(tape, config);
  rig.open().set({.baud = 300});
  for (int n = 0; n < 3; ++n) rig.write("a").wait(200'000);
  EXPECT_EQ(rig.finish(), Verdict::pass);
  EXPECT_EQ(rig.report->settings.recorded, 1U);
}

ReplayConfig cut_to(std::int64_t us) {
  ReplayConfig config;
  config.max_gap = Micros{us};
  return config;
}

TEST(MaxGap, LongerGapsAreCutToIt) {
  const auto tape = MemoryTape()
                        .read(1'000, "a")
                        .read(500'000, "b")
                        .event(800'000, event::Mark{"no step of the tape"})
                        .read(1'000'000, "c")
                        .read(1'005'000, "d");
  for (const ReplayConfig& config : {cut_to(10'000), at_recorded_times(cut_to(10'000))}) {
    Rig rig(tape, config);
    rig.open().until(100'000);
    EXPECT_EQ(rig.deliveries,
              (Deliveries{{1'000, "a", {1}}, {11'000, "b", {1}}, {21'000, "c", {1}}, {26'000, "d", {1}}}));
  }
}

TEST(MaxGap, RateCountsBehindIt) {
  ReplayConfig config = cut_to(10'000);
  config.rate = 2;
  Rig rig(MemoryTape().read(1'000, "a").read(500'000, "b"), config);
  rig.open().until(100'000);
  EXPECT_EQ(rig.deliveries, (Deliveries{{500, "a", {1}}, {5'500, "b", {1}}}));
}

TEST(MaxGap, ExpectedTimesOfWritesAreCutToo) {
  const auto tape = MemoryTape().write(1'000, "a").read(2'000, "A").write(900'000, "b").read(901'000, "B");
  for (const bool by_clock : {false, true}) {
    ReplayConfig config = timed(cut_to(20'000));
    if (by_clock) config.timing = Timing::recorded;
    Rig right(tape, config);
    right.open().until(1'000).write("a").until(24'000).write("b").until(50'000);
    EXPECT_EQ(right.finish(), Verdict::pass) << by_clock;
    Rig late(tape, config);
    late.open().until(1'000).write("a").until(28'000).write("b").until(50'000);
    EXPECT_EQ(late.finish(), Verdict::timing_mismatch) << by_clock;
    EXPECT_EQ(late.report->mismatch->error, Micros{6'000}) << by_clock;
    Rig early(tape, config);
    early.open().until(1'000).write("a").until(12'000).write("b").until(50'000);
    EXPECT_EQ(early.finish(), Verdict::timing_mismatch) << by_clock;
    EXPECT_EQ(early.report->mismatch->error, Micros{-10'000}) << by_clock;
  }
}

TEST(MaxGap, AWriteThatIsLateAcrossACutIsHeldAgainstItsOwnTime) {
  ReplayConfig config = at_recorded_times(timed(cut_to(20'000)));
  Rig rig(MemoryTape().write(10'000, "a").read(900'000, "A"), config);
  rig.open().until(14'000).write("a").until(100'000);
  EXPECT_EQ(rig.finish(), Verdict::pass);
}

TEST(GapCutsTest, MapsTimesToAndFro) {
  GapCuts cuts(Micros{10});
  cuts.begin(tape_time_us(0));
  for (const std::int64_t at : {5, 105, 110, 210}) cuts.reach(tape_time_us(at));
  const std::pair<std::int64_t, std::int64_t> same[] = {{0, 0},    {5, 5},    {105, 15},
                                                        {110, 20}, {210, 30}, {215, 35}};
  for (const auto& [tape, cut] : same) {
    EXPECT_EQ(cuts.cut(tape_time_us(tape)), tape_time_us(cut));
    EXPECT_EQ(cuts.uncut(tape_time_us(cut)), tape_time_us(tape));
  }
}

TEST(GapCutsTest, TheNewestOfManyAreKept) {
  GapCuts cuts(Micros{1});
  cuts.begin(tape_time_us(0));
  for (std::int64_t n = 1; n <= 10'000; ++n) cuts.reach(tape_time_us(n * 10));
  EXPECT_EQ(cuts.cut(tape_time_us(100'000)), tape_time_us(10'000));
  EXPECT_EQ(cuts.cut(tape_time_us(99'990)), tape_time_us(9'999));
}

}  // namespace
}  // namespace porttape::test
