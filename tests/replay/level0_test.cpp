// Strictness 0: how gates open when the driver writes something else.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

using ::testing::IsEmpty;

constexpr std::int64_t kQuiet = 50'000;
constexpr std::int64_t kPatience = 1'000'000;

ReplayConfig level0() {
  ReplayConfig config;
  config.strictness = 0;
  return config;
}

// Three questions of three bytes, each in two blocks; each answer 10 ms after its question.
MemoryTape three_questions() {
  return MemoryTape()
      .write(1'000, "q1")
      .write(1'500, "\n")
      .read(11'500, "A1")
      .write(21'000, "q2")
      .write(21'500, "\n")
      .read(31'500, "A2")
      .write(41'000, "q3")
      .write(41'500, "\n")
      .read(51'500, "A3");
}

TEST(Level0, IdenticalWritesFollowExactPositions) {
  Rig rig(three_questions(), level0());
  rig.open().write("q1\nq2\nq3\n").wait(100'000);
  EXPECT_EQ(rig.read(), "A1A2A3");
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->from_driver_matched, 9U);
}

// Found by seed 118085 of the simulation: a step over a long pause of the device answered a driver that was
// still writing.
TEST(Level0, AStepOverAPauseIsNoSilenceOfTheDriver) {
  const auto tape = MemoryTape()
                        .write(0, "q1")
                        .read(10'000, "A")
                        .read(3'000'000, "B")
                        .write(3'001'000, "q2")
                        .read(3'002'000, "C");
  Rig rig(tape, level0());
  rig.open().until(100).write("q1q").stand().step(2).wait(60'000'000);
  EXPECT_EQ(rig.read(), "AB");
  rig.stand(false).wait(kQuiet - 1);
  EXPECT_EQ(rig.read(), "");
  rig.wait(1);
  EXPECT_EQ(rig.read(), "C");
}
TEST(Level0, AStepOverAPauseIsNoPatienceEither) {
  ReplayClock clock(1);
  const Engine::Parts parts{.clock = &clock};
  Rig asked(MemoryTape().write(0, "q").read(10'000, "A"), level0(), true, 64, parts);
  Rig streams(MemoryTape().read(0, "a").read(60'000'000, "b"), level0(), true, 64, parts);
  asked.open();
  streams.open().until(100);
  asked.until(100);
  streams.stand().step(2).stand(false);
  EXPECT_EQ(streams.read(), "ab");
  asked.wait(kPatience - 1);
  EXPECT_EQ(asked.read(), "");
  asked.wait(1);
  EXPECT_EQ(asked.read(), "A");
}

TEST(Level0, OtherBytesOpenAGateByTheirNumber) {
  Rig rig(three_questions(), level0());
  rig.open().until(100).write("xyz").until(10'099);
  EXPECT_THAT(rig.deliveries, IsEmpty());
  rig.until(10'100);
  EXPECT_EQ(rig.read(), "A1");
  rig.write("xy").wait(9'000);
  EXPECT_EQ(rig.read(), "");
  rig.write("z").wait(9'999);
  EXPECT_EQ(rig.read(), "");
  rig.wait(1);
  EXPECT_EQ(rig.read(), "A2");
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_THAT(rig.mismatches, IsEmpty());
}

TEST(Level0, SurplusOfALongerQuestionDoesNotCountForTheNext) {
  Rig rig(three_questions(), level0());
  rig.open().write("xyzzy+1\n").wait(10'000);
  EXPECT_EQ(rig.read(), "A1");
  rig.wait(40'000);
  EXPECT_EQ(rig.read(), "");
  rig.write("another\n").wait(10'000);
  EXPECT_EQ(rig.read(), "A2");
}

TEST(Level0, SurplusMayComeByteByByte) {
  Rig rig(three_questions(), level0());
  rig.open();
  for (const char byte : std::string_view("xyzzy+1\n")) rig.write({&byte, 1}).wait(100);
  rig.wait(10'000);
  EXPECT_EQ(rig.read(), "A1");
  rig.wait(40'000);
  EXPECT_EQ(rig.read(), "");
  // The questions after it are compared again.
  rig.write("q2\n").wait(10'000);
  EXPECT_EQ(rig.read(), "A2");
  rig.close();
  EXPECT_EQ(rig.report->from_driver_matched, 3U);
}

TEST(Level0, ShorterQuestionOpensWhenTheDriverFallsQuiet) {
  Rig rig(three_questions(), level0());
  rig.open().write("x").until(kQuiet - 1);
  EXPECT_EQ(rig.read(), "");
  rig.until(kQuiet);
  EXPECT_EQ(rig.read(), "A1");
  rig.write("q2\n").wait(10'000);
  EXPECT_EQ(rig.read(), "A2");
}

TEST(Level0, QuietKeepsTheRecordedGapAfterTheLastByte) {
  Rig rig(MemoryTape().write(0, "abc").read(200'000, "A"), level0());
  rig.open().write("x").until(199'999);
  EXPECT_EQ(rig.read(), "");
  rig.until(200'000);
  EXPECT_EQ(rig.read(), "A");
}

TEST(Level0, WaitingForAGateIsNotOurLateness) {
  Rig rig(three_questions(), level0());
  rig.open().write("x").wait(kQuiet).wait(3 * kPatience).close();
  EXPECT_EQ(rig.read(), "A1A2A3");
  EXPECT_EQ(rig.report->timer_late_max_us, 0);
}

TEST(Level0, QuietStartsAnewWithEveryByte) {
  Rig rig(three_questions(), level0());
  rig.open().write("x").until(40'000).write("y").until(89'999);
  EXPECT_EQ(rig.read(), "");
  rig.until(90'000);
  EXPECT_EQ(rig.read(), "A1");
}

TEST(Level0, QuietAppliesToAnIdenticalBeginning) {
  Rig rig(three_questions(), level0());
  rig.open().write("q1").until(kQuiet);
  EXPECT_EQ(rig.read(), "A1");
}

TEST(Level0, SilentDriverIsServedByPatience) {
  Rig rig(three_questions(), level0());
  rig.open().until(11'500 + kPatience - 1);
  EXPECT_EQ(rig.read(), "");
  EXPECT_EQ(rig.deadline_us(), 11'500 + kPatience);
  rig.until(11'500 + kPatience);
  EXPECT_EQ(rig.read(), "A1");
  // The next answer was recorded 20 ms after this one.
  rig.until(31'500 + 2 * kPatience - 1);
  EXPECT_EQ(rig.read(), "");
  rig.until(31'500 + 2 * kPatience);
  EXPECT_EQ(rig.read(), "A2");
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Level0, PatienceRunsFromTheRealDelivery) {
  Rig rig(three_questions(), level0());
  rig.open().stall(5'000'000);
  EXPECT_EQ(rig.read(), "A1");
  rig.wait(kPatience - 1);
  EXPECT_EQ(rig.read(), "");
  rig.wait(1);
  EXPECT_EQ(rig.read(), "A2");
}

TEST(Level0, QuietAndPatienceAreRealTime) {
  ReplayConfig config = level0();
  config.rate = 10;
  Rig rig(three_questions(), config);
  rig.open().until(1'150 + kPatience - 1);
  EXPECT_EQ(rig.read(), "");
  rig.until(1'150 + kPatience);
  EXPECT_EQ(rig.read(), "A1");
  rig.write("x").wait(kQuiet - 1);
  EXPECT_EQ(rig.read(), "");
  rig.wait(1);
  EXPECT_EQ(rig.read(), "A2");
}

TEST(Level0, OtherBytesWrittenAheadOpenOneGateEach) {
  Rig rig(three_questions(), level0());
  rig.open().write("aaaa").wait(1'000).write("bbbb").wait(1'000).write("cccc").wait(100'000);
  EXPECT_EQ(rig.read(), "A1A2A3");
  EXPECT_EQ(rig.deliveries.at(2).us, 12'000);
}

TEST(Level0, TooFewBytesWrittenAheadDoNotOpenTheNextGate) {
  Rig rig(three_questions(), level0());
  rig.open().write("aaaa").wait(1'000).write("bbbb").wait(1'000).write("c").until(20'000);
  EXPECT_EQ(rig.read(), "A1A2");
  rig.until(2'000 + kQuiet - 1);
  EXPECT_EQ(rig.read(), "");
  rig.until(2'000 + kQuiet);
  EXPECT_EQ(rig.read(), "A3");
}

TEST(Level0, ExtraBytesAreIgnored) {
  Rig rig(three_questions(), level0());
  rig.open().write("q1\nq2\nq3\n").wait(100'000).write("q4\nq5\n").wait(100).write("q6").close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(exit_status_of(*rig.report), 0);
  EXPECT_EQ(rig.report->from_driver_bytes, 17U);
}

TEST(Level0, WithoutTimingTheRulesHoldToo) {
  ReplayConfig config = level0();
  config.timing = Timing::none;
  Rig rig(three_questions(), config);
  rig.open().write("xyz");
  EXPECT_EQ(rig.read(), "A1");
  rig.write("x");
  EXPECT_EQ(rig.read(), "");
  rig.wait(kQuiet);
  EXPECT_EQ(rig.read(), "A2");
}

TEST(WarnedDriver, IsServedByTheRulesOfLevel0AfterTheFirstDifference) {
  Rig rig(three_questions());
  rig.open().until(20'000'000);
  EXPECT_EQ(rig.read(), "");  // no patience before
  rig.write("x\n").wait(kQuiet);
  EXPECT_EQ(rig.read(), "A1");
  rig.wait(2 * kPatience);
  EXPECT_EQ(rig.read(), "A2");  // served by patience
  rig.write("q3\n").wait(10'000);
  EXPECT_EQ(rig.read(), "A3");
  EXPECT_EQ(rig.mismatches.size(), 1U);
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
}

TEST(WarnedDriver, OneReportAnExchange) {
  Rig rig(three_questions());
  rig.open();
  for (const char byte : std::string_view("totally different")) rig.write({&byte, 1}).wait(10);
  EXPECT_EQ(rig.mismatches.size(), 1U);
  rig.wait(20'000);
  EXPECT_EQ(rig.read(), "A1");
  rig.write("yyyy").wait(20'000).write("zzzz").wait(20'000);
  EXPECT_EQ(rig.read(), "A2A3");
  EXPECT_EQ(rig.mismatches.size(), 3U);
  EXPECT_EQ(rig.mismatches[1].exchange, 2U);
  EXPECT_EQ(rig.mismatches[2].exchange, 3U);
  EXPECT_EQ(rig.mismatches[2].offset, 21U);
}

TEST(WarnedDriver, ExtraIsToldOnce) {
  Rig rig(MemoryTape().write(0, "q").read(10, "a"));
  rig.open().write("q").wait(10).write("x").wait(100'000).write("y").wait(100'000).write("z").close();
  EXPECT_EQ(rig.verdict(), Verdict::extra);
  EXPECT_EQ(rig.mismatches.size(), 1U);
}

}  // namespace
}  // namespace porttape::test
