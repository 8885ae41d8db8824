#include "libport/loop/stall_watch.hpp"

#include <chrono>
#include <vector>

#include <gtest/gtest.h>

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr Instant kBegin{seconds(100)};

class StallWatchTest : public testing::Test {
 protected:
  StallWatchTest() {
    watch.on_stall([this](const Stall& stall) { told.push_back(stall); });
  }
  // Nothing was done for `time`, `after` kBegin.
  void late(Nanos after, Nanos time) { watch.late(kBegin + after, kBegin + after + time); }
  std::vector<Stall> all() const { return watch.since(Instant{}); }

  StallWatch watch;
  std::vector<Stall> told;
};

TEST_F(StallWatchTest, FiftyMillisecondsAreNoStallYet) {
  late(Nanos(0), StallWatch::kShortest);
  EXPECT_TRUE(all().empty());
  late(Nanos(0), StallWatch::kShortest + Nanos(1));
  ASSERT_EQ(all().size(), 1U);
  EXPECT_EQ(all().front(), (Stall{kBegin, StallWatch::kShortest + Nanos(1)}));
  EXPECT_EQ(told, all());
}

TEST_F(StallWatchTest, OneThatBeginsWhereTheLastEndedMakesThatLonger) {
  late(Nanos(0), milliseconds(100));
  late(milliseconds(100), milliseconds(60));
  EXPECT_EQ(all(), (std::vector<Stall>{{kBegin, milliseconds(160)}}));
  EXPECT_EQ(told.size(), 1U) << "it is told once";
}

TEST_F(StallWatchTest, OneThatBeginsLaterIsAnother) {
  late(Nanos(0), milliseconds(100));
  late(milliseconds(100) + Nanos(1), milliseconds(60));
  ASSERT_EQ(all().size(), 2U);
  EXPECT_EQ(all().back().length, milliseconds(60));
  EXPECT_EQ(told.size(), 2U);
}

TEST_F(StallWatchTest, OneWithinTheLastChangesNothing) {
  late(Nanos(0), milliseconds(200));
  late(milliseconds(50), milliseconds(60));
  EXPECT_EQ(all(), (std::vector<Stall>{{kBegin, milliseconds(200)}}));
}

TEST_F(StallWatchTest, OneAroundTheLastReplacesIt) {
  late(milliseconds(50), milliseconds(60));
  late(Nanos(0), milliseconds(200));
  EXPECT_EQ(all(), (std::vector<Stall>{{kBegin, milliseconds(200)}}));
}

TEST_F(StallWatchTest, ThoseThatEndedAfterAMomentAreGiven) {
  late(Nanos(0), milliseconds(100));
  late(seconds(1), milliseconds(100));
  const Instant end = kBegin + milliseconds(100);
  EXPECT_EQ(watch.since(end - Nanos(1)).size(), 2U);
  ASSERT_EQ(watch.since(end).size(), 1U);
  EXPECT_EQ(watch.since(end).front().begin, kBegin + seconds(1));
}

TEST_F(StallWatchTest, TheLatestSixtyFourAreKept) {
  for (std::size_t n = 0; n < StallWatch::kKept; ++n) late(seconds(n), milliseconds(100));
  EXPECT_EQ(all().size(), StallWatch::kKept);
  EXPECT_EQ(all().front().begin, kBegin);
  late(seconds(StallWatch::kKept), milliseconds(100));
  EXPECT_EQ(all().size(), StallWatch::kKept);
  EXPECT_EQ(all().front().begin, kBegin + seconds(1)) << "the oldest is forgotten";
  EXPECT_EQ(told.size(), StallWatch::kKept + 1);
}

TEST(StallWatchWithoutAHook, KeepsStallsAllTheSame) {
  StallWatch watch;
  watch.late(kBegin, kBegin + seconds(1));
  EXPECT_EQ(watch.since(Instant{}).size(), 1U);
}

}  // namespace
}  // namespace porttape
