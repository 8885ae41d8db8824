// timing=reactive: when reads become due.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// Two exchanges: the answers come 10 and 5 ms after the questions; the driver thinks for 20 ms in between.
MemoryTape two_exchanges() {
  return MemoryTape()
      .open(0)
      .write(1'000, "Q1\n")
      .read(11'000, "A1\n")
      .write(31'000, "Q2\n")
      .read(36'000, "A2\n")
      .close(50'000);
}

TEST(Reactive, AnswerComesTheRecordedGapAfterTheDriversOwnQuestion) {
  Rig rig(two_exchanges());
  rig.open().until(500'000);
  EXPECT_THAT(rig.deliveries, IsEmpty());
  rig.write("Q1\n").until(509'999);
  EXPECT_THAT(rig.deliveries, IsEmpty());
  rig.until(600'000);
  EXPECT_THAT(rig.deliveries, ElementsAre(Rig::Delivery{510'000, "A1\n", {3}}));
  rig.write("Q2\n").until(700'000);
  EXPECT_EQ(rig.deliveries.back(), (Rig::Delivery{605'000, "A2\n", {3}}));
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->to_driver_bytes, 6U);
  EXPECT_EQ(rig.report->to_driver_of, 6U);
  EXPECT_EQ(rig.report->from_driver_matched, 6U);
  EXPECT_EQ(rig.report->from_driver_of, 6U);
  EXPECT_EQ(rig.report->duration, Nanos{700'000'000});
}

TEST(Reactive, NothingIsDueWhileTheDriverHasNotAsked) {
  Rig rig(two_exchanges());
  rig.open();
  EXPECT_EQ(rig.deadline_us(), std::nullopt);
  rig.write("Q1");
  EXPECT_EQ(rig.deadline_us(), std::nullopt);
  rig.write("\n");
  EXPECT_EQ(rig.deadline_us(), 10'000);
}

TEST(Reactive, NoSilentStallIsBrokenByPatience) {
  Rig rig(two_exchanges());
  rig.open().write("Q1").until(100'000'000);
  EXPECT_THAT(rig.deliveries, IsEmpty());
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::incomplete);
}

TEST(Reactive, UnsolicitedReadsAreTimedFromTheOpen) {
  Rig rig(MemoryTape().read(5'000, "boot").read(9'000, "ok"));
  rig.until(70'000).open().until(200'000);
  EXPECT_THAT(rig.deliveries,
              ElementsAre(Rig::Delivery{75'000, "boot", {4}}, Rig::Delivery{79'000, "ok", {2}}));
}

TEST(Reactive, ReadsAreNeverReordered) {
  // The second answer was recorded 1 ms after its question, the first 100 ms after.
  Rig rig(MemoryTape().write(0, "a").read(100'000, "A").write(100'500, "b").read(101'500, "B"));
  rig.open().write("ab").until(1'000'000);
  ASSERT_EQ(rig.deliveries.size(), 1U);
  EXPECT_EQ(rig.deliveries[0], (Rig::Delivery{100'000, "AB", {1, 2}}));
}

TEST(Reactive, DriverMayWriteAheadAcrossSeveralExchanges) {
  Rig rig(MemoryTape().write(0, "a").read(10, "A").write(20, "b").read(30, "B").write(40, "c").read(5'000'000,
                                                                                                    "C"));
  rig.open().write("abc").until(1'000);
  EXPECT_EQ(rig.read(), "AB");
  rig.until(6'000'000);
  EXPECT_EQ(rig.deliveries.back().us, 4'999'960);
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Reactive, RateDividesTheGaps) {
  for (const auto& [rate, due] : {std::pair{0.5, 20'000}, std::pair{1.0, 10'000}, std::pair{10.0, 1'000}}) {
    ReplayConfig config;
    config.rate = rate;
    Rig rig(two_exchanges(), config);
    rig.open().write("Q1\n").until(due - 1);
    EXPECT_THAT(rig.deliveries, IsEmpty()) << rate;
    rig.until(due);
    EXPECT_EQ(rig.read(), "A1\n") << rate;
  }
}

TEST(Reactive, LateServiceDoesNotAddUp) {
  MemoryTape tape;
  tape.write(0, "go");
  for (int i = 1; i <= 10; ++i) tape.read(i * 10'000, "x");
  Rig rig(std::move(tape));
  rig.open().write("go");
  rig.stall(17'000);  // the first one is 7 ms late
  rig.until(100'000);
  ASSERT_EQ(rig.deliveries.size(), 10U);
  EXPECT_EQ(rig.deliveries[0].us, 17'000);
  EXPECT_EQ(rig.deliveries[1].us, 20'000);
  EXPECT_EQ(rig.deliveries[9].us, 100'000);
}

TEST(Reactive, EverythingDueIsOneDelivery) {
  Rig rig(
      MemoryTape().write(0, "go").read(1'000, "ab").read(2'000, "cd").read(3'000, "ef").read(9'000, "gh"));
  rig.open().write("go").stall(5'000);
  EXPECT_THAT(rig.deliveries, ElementsAre(Rig::Delivery{5'000, "abcdef", {2, 4, 6}}));
}

TEST(Reactive, QuestionsInSeveralBlocksCountFromTheLast) {
  Rig rig(MemoryTape().write(26, "VV").write(935, "\n").read(10'935, "VV\n00P\n"));
  rig.open().until(1'000).write("VV").until(50'000).write("\n").until(59'999);
  EXPECT_THAT(rig.deliveries, IsEmpty());
  rig.until(60'000);
  EXPECT_EQ(rig.read(), "VV\n00P\n");
}

TEST(Reactive, OnATieTheTapesOrderCounts) {
  Rig rig(MemoryTape().write(1'000, "q").read(1'000, "r").write(1'000, "s").read(1'000, "t"));
  rig.open().until(100);
  EXPECT_EQ(rig.read(), "");
  rig.write("q");
  EXPECT_EQ(rig.read(), "r");
  rig.write("s");
  EXPECT_EQ(rig.read(), "t");
}

TEST(Reactive, ZeroLengthBlocksAreNothing) {
  Rig rig(MemoryTape()
              .write(0, "")
              .read(0, "")
              .write(10, "q")
              .write(500'000, "")
              .read(600'000, "")
              .read(1'010, "r")
              .write(2'000, ""),
          {}, true);
  rig.open().write("q").until(1'000);
  EXPECT_EQ(rig.read(), "r");
  EXPECT_EQ(rig.finish(), Verdict::pass);
}

TEST(Reactive, AMillionZeroLengthBlocksAreFine) {
  MemoryTape tape;
  for (int i = 0; i < 500'000; ++i) tape.write(1, "").read(1, "");
  tape.write(2, "q").read(3, "r");
  Rig rig(std::move(tape));
  rig.open().write("q").wait(10);
  EXPECT_EQ(rig.read(), "r");
  EXPECT_EQ(rig.finish(), Verdict::pass);
}

TEST(Reactive, BlocksInPiecesPlayAsOne) {
  const std::string question(1000, 'q');
  const std::string answer(5000, 'a');
  for (const std::size_t piece : {1U, 7U, 999U, 1000U, 5000U}) {
    Rig rig(MemoryTape().write(0, question).read(2'000, answer).read(3'000, "b"), {}, true, piece);
    rig.open().write(question).until(10'000);
    EXPECT_THAT(rig.deliveries,
                ElementsAre(Rig::Delivery{2'000, answer, {5000}}, Rig::Delivery{3'000, "b", {1}}))
        << piece;
    EXPECT_EQ(rig.finish(), Verdict::pass);
  }
}

TEST(Reactive, MaxBytesCutsADeliveryAndTheRestStaysDue) {
  Rig rig(MemoryTape().read(0, "abcdef").read(0, "gh").read(0, "i"));
  rig.max_bytes = 4;
  rig.open();
  EXPECT_THAT(rig.deliveries, ElementsAre(Rig::Delivery{0, "abcd", {4}}, Rig::Delivery{0, "efgh", {2, 4}},
                                          Rig::Delivery{0, "i", {1}}));
}

TEST(Reactive, DeadlineHasComeWhileMoreIsDue) {
  Rig rig(MemoryTape().read(0, "abcdef"));
  rig.engine.on_open(rig.now());
  EXPECT_EQ(rig.engine.next_deadline(), rig.now());
  EXPECT_EQ(rig.engine.advance(rig.now(), 4).deliver.size(), 4U);
  EXPECT_EQ(rig.engine.next_deadline(), rig.now());
  EXPECT_EQ(rig.engine.advance(rig.now(), 4).deliver.size(), 2U);
  EXPECT_EQ(rig.engine.next_deadline(), std::nullopt);
}

TEST(NoTiming, OrderIsKeptWithoutDelays) {
  ReplayConfig config;
  config.timing = Timing::none;
  Rig rig(two_exchanges(), config);
  rig.open();
  EXPECT_EQ(rig.read(), "");
  rig.write("Q1\n");
  EXPECT_EQ(rig.read(), "A1\n");
  rig.write("Q2\n");
  EXPECT_EQ(rig.read(), "A2\n");
  EXPECT_EQ(rig.finish(), Verdict::pass);
}

TEST(NoTiming, StrictnessTwoActsAsOne) {
  ReplayConfig config;
  config.timing = Timing::none;
  config.strictness = 2;
  Rig rig(two_exchanges(), config);
  rig.open().wait(5'000'000).write("Q1\n").wait(5'000'000).write("Q2\n").close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->strictness, 1);
}

}  // namespace
}  // namespace porttape::test
