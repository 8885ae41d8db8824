// Strictness 2: the time of the driver's writes.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr std::int64_t kJitter = 5'000;

ReplayConfig level2(Timing timing = Timing::reactive, double rate = 1) {
  ReplayConfig config;
  config.strictness = 2;
  config.jitter = Micros{kJitter};
  config.timing = timing;
  config.rate = rate;
  config.on_mismatch = OnMismatch::fail;
  return config;
}

// The driver asks 20 ms after its open, and again 30 ms after the answer.
MemoryTape two_questions() {
  return MemoryTape().open(0).write(20'000, "Q1").read(30'000, "A1").write(60'000, "Q2").read(70'000, "A2");
}

TEST(Level2, TheMarginIsAllowedOnBothSides) {
  for (const std::int64_t off : {-kJitter, std::int64_t{0}, kJitter}) {
    Rig rig(two_questions(), level2());
    rig.open().until(20'000 + off).write("Q1").wait(10'000);
    ASSERT_EQ(rig.read(), "A1");
    rig.wait(30'000 + off).write("Q2").wait(10'000).close();
    EXPECT_EQ(rig.verdict(), Verdict::pass) << off;
  }
}

TEST(Level2, OneMicrosecondMoreIsATimingMismatch) {
  for (const std::int64_t off : {-kJitter - 1, kJitter + 1}) {
    Rig rig(two_questions(), level2());
    rig.open().until(20'000 + off).write("Q1").wait(100'000);
    EXPECT_EQ(rig.verdict(), Verdict::timing_mismatch) << off;
    EXPECT_EQ(exit_status_of(*rig.report), 4);
    EXPECT_TRUE(rig.hung_up);
    EXPECT_THAT(rig.deliveries, IsEmpty());
    ASSERT_THAT(rig.mismatches, SizeIs(1));
    EXPECT_EQ(rig.mismatches[0].kind, MismatchKind::timing);
    EXPECT_EQ(rig.mismatches[0].error, Micros{off});
    EXPECT_EQ(rig.mismatches[0].offset, 1U);
    EXPECT_EQ(to_us(rig.mismatches[0].tape), 20'000);
    EXPECT_EQ(rig.mismatches[0].real, Micros{20'000 + off});
    EXPECT_EQ(rig.mismatches[0].exchange, 1U);
  }
}

TEST(Level2, AWriteIsMeasuredFromTheRealDelivery) {
  Rig rig(two_questions(), level2());
  rig.open().until(20'000).write("Q1");
  rig.stall(40'000);  // the answer is 30 ms late, by our own fault
  ASSERT_EQ(rig.deliveries.at(0).us, 60'000);
  rig.wait(30'000).write("Q2").wait(10'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->timer_late_max_us, 30'000);
}

TEST(Level2, AFaultTellsOurOwnLateness) {
  Rig rig(two_questions(), level2());
  rig.open().until(20'000).write("Q1").stall(12'000).wait(90'000).write("Q2");
  ASSERT_THAT(rig.mismatches, SizeIs(1));
  EXPECT_EQ(rig.mismatches[0].error, Micros{60'000});
  EXPECT_EQ(rig.mismatches[0].own_late, Micros{2'000});
}

TEST(Level2, ErrorsDoNotAddUp) {
  MemoryTape steps;
  for (int i = 1; i <= 20; ++i) steps.write(i * 10'000, "x");
  Rig rig(std::move(steps), level2());
  rig.open();
  for (int i = 1; i <= 20; ++i) rig.wait(10'000 + kJitter).write("x");
  EXPECT_EQ(rig.finish(), Verdict::pass);
}

TEST(Level2, GapsFollowTheRateAndTheMarginDoesNot) {
  for (const auto& [rate, due] : {std::pair{0.5, 40'000}, std::pair{10.0, 2'000}}) {
    for (const std::int64_t off : {kJitter, kJitter + 1}) {
      Rig rig(two_questions(), level2(Timing::reactive, rate));
      rig.open().until(due + off).write("Q1");
      EXPECT_EQ(rig.runs, off > kJitter ? 1 : 0) << rate << ' ' << off;
    }
  }
}

TEST(Level2, AWriteAheadOfAnAnswerIsJudgedWhenTheWalkGetsThere) {
  Rig rig(two_questions(), level2());
  rig.open().until(20'000).write("Q1").wait(1'000).write("Q2");
  EXPECT_THAT(rig.mismatches, IsEmpty());
  rig.wait(8'999);
  EXPECT_EQ(rig.read(), "");
  rig.wait(1);
  EXPECT_EQ(rig.read(), "A1");
  ASSERT_THAT(rig.mismatches, SizeIs(1));
  EXPECT_EQ(rig.mismatches[0].error, Micros{-39'000});
  EXPECT_EQ(rig.mismatches[0].offset, 3U);
  EXPECT_EQ(rig.verdict(), Verdict::timing_mismatch);
}

TEST(Level2, AWriteAheadIsJudgedAtTheCloseAtLast) {
  Rig rig(MemoryTape().write(20'000, "Q1").read(30'000, "A1").write(60'000, "Q2"), level2());
  rig.open().until(20'000).write("Q1").write("Q2").close();
  EXPECT_EQ(rig.verdict(), Verdict::timing_mismatch);
  EXPECT_EQ(rig.report->mismatch->error, Micros{-40'000});
}

TEST(Level2, BlocksWrittenAtOnceAreToldApart) {
  Rig rig(two_questions(), level2());
  rig.open().write("Q1Q2");
  EXPECT_EQ(rig.mismatches.at(0).offset, 1U);
  EXPECT_EQ(rig.mismatches.at(0).error, Micros{-20'000});
}

TEST(Level2, AWriteAheadIsJudgedAtTheProgramsEndAtLast) {
  Rig rig(MemoryTape().write(20'000, "Q1").read(30'000, "A1").write(60'000, "Q2"), level2());
  rig.open().until(20'000).write("Q1").write("Q2");
  EXPECT_EQ(rig.finish(), Verdict::timing_mismatch);
}

TEST(Level2, TheLastByteOfABlockCounts) {
  Rig rig(two_questions(), level2());
  rig.open().until(1'000).write("Q").until(20'000).write("1").wait(10'000);
  EXPECT_EQ(rig.read(), "A1");
}

TEST(Level2, BlocksOfOneQuestionAreTimedEach) {
  const auto pause = MemoryTape().write(0, "VV").write(100'000, "\n").read(110'000, "ok");
  Rig split(pause, level2());
  split.open().write("VV").wait(100'000).write("\n").wait(10'000).close();
  EXPECT_EQ(split.verdict(), Verdict::pass);
  Rig whole(pause, level2());
  whole.open().write("VV\n");
  EXPECT_EQ(whole.verdict(), Verdict::timing_mismatch);
  EXPECT_EQ(whole.report->mismatch->error, Micros{-100'000});
}

TEST(Level2, DataOutranksTimingUnderWarn) {
  ReplayConfig config = level2();
  config.on_mismatch = OnMismatch::warn;
  Rig rig(two_questions(), config);
  rig.open().until(50'000).write("Q1").wait(10'000);
  EXPECT_EQ(rig.read(), "A1");
  rig.wait(30'000).write("QX").wait(60'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.report->mismatch->kind, MismatchKind::data);
  EXPECT_EQ(rig.report->mismatches, 2U);
}

TEST(Level2, TimingOnlyUnderWarnGoesOn) {
  ReplayConfig config = level2();
  config.on_mismatch = OnMismatch::warn;
  Rig rig(two_questions(), config);
  rig.open().until(50'000).write("Q1").wait(10'000).wait(60'000).write("Q2").wait(10'000);
  EXPECT_EQ(rig.read(), "A1A2");
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::timing_mismatch);
  EXPECT_EQ(rig.report->mismatches, 2U);
  EXPECT_EQ(rig.report->mismatch->error, Micros{30'000});
}

TEST(Level2, MissingWritesOutrankTimingUnderWarn) {
  ReplayConfig config = level2();
  config.on_mismatch = OnMismatch::warn;
  Rig rig(two_questions(), config);
  rig.open().until(50'000).write("Q1").wait(10'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::incomplete);
  EXPECT_EQ(rig.report->mismatch->kind, MismatchKind::timing);
}

TEST(Level2, DataMismatchUnderWarnIsFollowedByTimedExchanges) {
  ReplayConfig config = level2();
  config.on_mismatch = OnMismatch::warn;
  Rig rig(two_questions(), config);
  rig.open().until(20'000).write("XX").wait(10'000);
  EXPECT_EQ(rig.read(), "A1");
  rig.wait(90'000).write("Q2").wait(10'000);
  EXPECT_EQ(rig.read(), "A2");
  ASSERT_THAT(rig.mismatches, SizeIs(2));
  EXPECT_EQ(rig.mismatches[1].error, Micros{60'000});
}

TEST(Level2, SilenceUnderWarnAfterAMismatchDoesNotStall) {
  ReplayConfig config = level2();
  config.on_mismatch = OnMismatch::warn;
  Rig rig(two_questions(), config);
  rig.open().until(20'000).write("XX").wait(10'000);
  EXPECT_EQ(rig.read(), "A1");
  rig.wait(5'000'000);
  EXPECT_EQ(rig.read(), "A2");
}

TEST(Level2Recorded, AWriteIsMeasuredFromTheOpen) {
  for (const std::int64_t off : {-kJitter - 1, -kJitter, kJitter, kJitter + 1}) {
    Rig rig(two_questions(), level2(Timing::recorded));
    rig.until(7'000)
        .open()
        .until(7'000 + 20'000)
        .write("Q1")
        .until(7'000 + 60'000 + off)
        .write("Q2")
        .wait(50'000)
        .close();
    const bool fault = off < -kJitter || off > kJitter;
    EXPECT_EQ(rig.verdict(), fault ? Verdict::timing_mismatch : Verdict::pass) << off;
    EXPECT_EQ(rig.mismatches.size(), fault ? 1U : 0U);
    for (const Mismatch& mismatch : rig.mismatches) EXPECT_EQ(mismatch.error, Micros{off});
  }
}

}  // namespace
}  // namespace porttape::test
