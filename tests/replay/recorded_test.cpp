// timing=recorded, chunks, the blocked line, the tape's end.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

MemoryTape asked_stream() {
  return MemoryTape()
      .open(0)
      .read(10'000, "a")
      .write(15'000, "Q")
      .read(20'000, "b")
      .read(30'000, "c")
      .close(40'000);
}

TEST(Recorded, BlocksComeAtTheirTimesWhateverTheDriverDoes) {
  Rig rig(asked_stream(), recorded());
  rig.until(5'000).open().until(100'000);
  EXPECT_THAT(rig.deliveries, ElementsAre(Rig::Delivery{15'000, "a", {1}}, Rig::Delivery{25'000, "b", {1}},
                                          Rig::Delivery{35'000, "c", {1}}));
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::incomplete);
}

TEST(Recorded, RateAppliesFromTheOpen) {
  ReplayConfig config = recorded();
  config.rate = 2;
  Rig rig(asked_stream(), config);
  rig.open().until(100'000);
  EXPECT_EQ(rig.deliveries.at(2).us, 15'000);
}

TEST(Recorded, WritesAreCheckedAsAStreamToo) {
  Rig rig(asked_stream(), recorded());
  rig.open().until(90'000).write("Q").close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  Rig other(asked_stream(), recorded());
  other.open().write("R").close();
  EXPECT_EQ(other.verdict(), Verdict::data_mismatch);
}

TEST(Recorded, AfterAMismatchWritesAreComparedAgainByTheirTime) {
  MemoryTape tape;
  for (int i = 0; i < 10; ++i)
    tape.write(i * 1'000'000, "q" + std::to_string(i) + "\n").read(i * 1'000'000 + 1'000, "x");
  Rig rig(std::move(tape), recorded());
  rig.open().until(20'000).write("q0\n").until(1'020'000).write("oops").until(2'020'000).write("q2\n").until(
      3'020'000);
  rig.write("q3\n").until(3'900'000).close();
  EXPECT_EQ(rig.mismatches.size(), 1U);
  EXPECT_EQ(rig.report->from_driver_matched, 9U);
}

TEST(Recorded, ReopenOnTapeFollowsTheDriversOwn) {
  const auto tape =
      MemoryTape().open(0).read(10'000, "a").close(20'000).open(500'000).read(510'000, "b").close(520'000);
  Rig rig(tape, recorded());
  rig.open().until(30'000).close().until(1'000'000).open().until(2'000'000);
  EXPECT_THAT(rig.deliveries,
              ElementsAre(Rig::Delivery{10'000, "a", {1}}, Rig::Delivery{1'010'000, "b", {1}}));
  EXPECT_EQ(rig.runs, 0);
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Recorded, ReopenIsPassedByTimeWhenTheDriverNeverCloses) {
  const auto tape =
      MemoryTape().open(0).read(10'000, "a").close(20'000).open(500'000).read(510'000, "b").close(520'000);
  Rig rig(tape, recorded());
  rig.open().until(3'000'000);
  EXPECT_THAT(rig.deliveries, ElementsAre(Rig::Delivery{10'000, "a", {1}}, Rig::Delivery{510'000, "b", {1}}));
  rig.close();
  EXPECT_EQ(rig.runs, 1);
}

TEST(Recorded, ADriverThatReopensABitLateIsStillInTheRun) {
  const auto tape = MemoryTape()
                        .open(0)
                        .read(10'000, "a")
                        .close(20'000)
                        .open(21'000)
                        .write(25'000, "q")
                        .read(60'000, "b")
                        .close(70'000);
  Rig rig(tape, recorded());
  rig.open().until(30'000).close().until(32'000).open().until(40'000).write("q").until(70'999);
  EXPECT_EQ(rig.read(), "a");
  rig.until(71'000);
  EXPECT_EQ(rig.read(), "b");
  rig.close();
  EXPECT_EQ(rig.runs, 1);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Recorded, ACloseAtTheTapesEndIsNoLateReopen) {
  const auto tape =
      MemoryTape().open(0).read(10'000, "a").close(20'000).open(21'000).read(22'000, "b").close(23'000);
  Rig rig(tape, recorded());
  rig.open().until(22'500).close();
  EXPECT_EQ(rig.read(), "ab");
  EXPECT_EQ(rig.runs, 1);
}

TEST(Recorded, TheTapeIsNotUsedUpBeforeItsLastWriteWasDue) {
  ReplayConfig config = recorded(0);
  config.at_end = AtEnd::exit;
  Rig rig(MemoryTape().read(0, "a").write(500'000, "q"), config);
  rig.open().until(499'999);
  EXPECT_FALSE(rig.exits);
  rig.until(500'000);
  EXPECT_TRUE(rig.exits);
}

TEST(Recorded, TheTapeIsNotUsedUpBeforeAllWritesCame) {
  ReplayConfig config = recorded();
  config.at_end = AtEnd::exit;
  Rig rig(asked_stream(), config);
  rig.open().until(1'000'000);
  EXPECT_FALSE(rig.exits);
  rig.write("Q");
  EXPECT_TRUE(rig.exits);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Recorded, ContinueDropsWhatCameWhileClosed) {
  ReplayConfig config = recorded();
  config.on_reopen = OnReopen::continue_;
  Rig rig(asked_stream(), config);
  rig.open().until(12'000).close().until(25'000).open().until(100'000);
  EXPECT_THAT(rig.deliveries, ElementsAre(Rig::Delivery{10'000, "a", {1}}, Rig::Delivery{30'000, "c", {1}}));
}

TEST(Chunks, RecordedKeepsBlocksAndBurstJoinsThem) {
  const auto tape =
      MemoryTape().write(0, "q").read(1'000, "a").read(1'499, "b").read(1'998, "c").read(2'498, "d");
  ReplayConfig config;
  config.chunks = Chunks::recorded;
  Rig apart(tape, config);
  apart.open().write("q").wait(10'000);
  EXPECT_THAT(apart.deliveries, ElementsAre(Rig::Delivery{1'000, "a", {1}}, Rig::Delivery{1'499, "b", {1}},
                                            Rig::Delivery{1'998, "c", {1}}, Rig::Delivery{2'498, "d", {1}}));
  config.chunks = Chunks::burst;
  Rig joined(tape, config);
  joined.open().write("q").wait(10'000);
  EXPECT_THAT(joined.deliveries,
              ElementsAre(Rig::Delivery{1'000, "abc", {3}}, Rig::Delivery{2'498, "d", {1}}));
}

TEST(Chunks, AutomaticIsRecordedForTapesStampedAtArrival) {
  const auto tape = MemoryTape().read(1'000, "a").read(1'100, "b");
  Rig ours(tape, {}, true);
  ours.open().wait(10'000);
  EXPECT_EQ(ours.deliveries.size(), 2U);
  Rig others(tape, {}, false);
  others.open().wait(10'000);
  EXPECT_THAT(others.deliveries, ElementsAre(Rig::Delivery{1'000, "ab", {2}}));
}

TEST(Chunks, AWriteEndsABurst) {
  Rig rig(MemoryTape().read(1'000, "a").write(1'100, "q").read(1'200, "b").read(1'300, "c"), {}, false);
  rig.open().wait(5'000).write("q").wait(99);
  EXPECT_EQ(rig.read(), "a");
  rig.wait(1);
  EXPECT_EQ(rig.read(), "bc");
}

TEST(Chunks, AnEndlessBurstIsCutAtATenthOfASecond) {
  MemoryTape tape;
  for (int i = 0; i < 1'000; ++i) tape.read(i * 400, "x");
  Rig rig(std::move(tape), {}, false);
  rig.open().wait(1'000'000);
  ASSERT_EQ(rig.deliveries.size(), 4U);
  EXPECT_EQ(rig.deliveries[0].bytes.size(), 250U);
  EXPECT_EQ(rig.deliveries[1].us, 100'000);
}

TEST(Blocked, NothingIsDeliveredAndNoLatenessCounted) {
  Rig rig(MemoryTape().write(0, "q").read(1'000, "a").read(2'000, "b").read(60'000, "c"));
  rig.open().write("q").blocked(true).wait(50'000);
  EXPECT_THAT(rig.deliveries, IsEmpty());
  EXPECT_EQ(rig.deadline_us(), std::nullopt);
  rig.blocked(false);
  EXPECT_THAT(rig.deliveries, ElementsAre(Rig::Delivery{50'000, "ab", {1, 2}}));
  rig.stall(13'000).close();
  EXPECT_EQ(rig.report->timer_late_max_us, 3'000);
}

TEST(AtEnd, IdleDoesNothing) {
  Rig rig(asked_stream());
  rig.open().wait(10'000).write("Q").wait(10'000'000);
  EXPECT_EQ(rig.runs, 0);
  EXPECT_FALSE(rig.hung_up);
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(AtEnd, HangupBreaksTheLineWhenAllWentOver) {
  ReplayConfig config;
  config.at_end = AtEnd::hangup;
  Rig rig(MemoryTape().read(0, "a").write(10, "Q"), config);
  rig.open().wait(1'000'000);
  EXPECT_FALSE(rig.hung_up);
  rig.write("Q");
  EXPECT_TRUE(rig.hung_up);
  EXPECT_FALSE(rig.exits);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  rig.close();
  EXPECT_EQ(rig.runs, 1);
}

TEST(AtEnd, ExitEndsTheRunWithTheLastDelivery) {
  ReplayConfig config;
  config.at_end = AtEnd::exit;
  Rig rig(asked_stream(), config);
  rig.open().wait(10'000).write("Q").wait(14'999);
  EXPECT_FALSE(rig.exits);
  rig.wait(1);
  EXPECT_TRUE(rig.exits);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->to_driver_bytes, 3U);
}

TEST(AtEnd, StrictnessZeroDoesNotWaitForTrailingWritesForEver) {
  ReplayConfig config;
  config.at_end = AtEnd::exit;
  config.strictness = 0;
  Rig rig(MemoryTape().read(0, "a").write(10, "Q"), config);
  rig.open().wait(1'000'009);
  EXPECT_FALSE(rig.exits);
  rig.wait(1);
  EXPECT_TRUE(rig.exits);
}

}  // namespace
}  // namespace porttape::test
