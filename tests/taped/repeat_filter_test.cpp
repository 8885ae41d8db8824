#include "libport/taped/repeat_filter.hpp"

#include <gtest/gtest.h>

namespace porttape {
namespace {

using std::chrono::milliseconds;

constexpr SeenSettings kSlow{.baud = 300};
constexpr SeenSettings kFast{.baud = 115200};

TEST(RepeatFilter, SettingsThatAreAsTheyWereAreNoNews) {
  RepeatFilter filter;
  EXPECT_TRUE(filter.is_new(Side::device, SeenSettings::of({})));
  EXPECT_FALSE(filter.is_new(Side::device, SeenSettings::of({})));
  EXPECT_TRUE(filter.is_new(Side::driver, kFast));
  EXPECT_FALSE(filter.is_new(Side::driver, kFast));
  EXPECT_TRUE(filter.is_new(Side::driver, kSlow));
  EXPECT_TRUE(filter.is_new(Side::driver, kFast));
}

TEST(RepeatFilter, WhatTheOtherSideHasChangedSinceIsNewAgain) {
  RepeatFilter filter;
  EXPECT_TRUE(filter.is_new(Side::driver, kFast));
  EXPECT_TRUE(filter.is_new(Side::device, kSlow)) << "it took another rate";
  EXPECT_TRUE(filter.is_new(Side::driver, kFast));
  EXPECT_TRUE(filter.is_new(Side::device, kSlow));
  EXPECT_FALSE(filter.is_new(Side::device, kSlow));
}

TEST(RepeatFilter, WhatTheOtherSideHasSaidTooIsStillNewOnce) {
  RepeatFilter filter;
  EXPECT_TRUE(filter.is_new(Side::device, kFast));
  EXPECT_TRUE(filter.is_new(Side::driver, kFast));
  EXPECT_FALSE(filter.is_new(Side::device, kFast));
}

TEST(RepeatFilter, EachSessionsFirstSettingsOfTheDriverAreNew) {
  RepeatFilter filter;
  EXPECT_TRUE(filter.is_new(Side::device, kSlow));
  EXPECT_TRUE(filter.is_new(Side::driver, kSlow));
  filter.begin_session();
  EXPECT_FALSE(filter.is_new(Side::device, kSlow));
  EXPECT_TRUE(filter.is_new(Side::driver, kSlow));
}

TEST(RepeatFilter, AFlushThatCanDropNothingMoreIsNoNews) {
  RepeatFilter filter;
  Instant now{};
  EXPECT_TRUE(filter.is_new(FlushQueue::in, now));
  EXPECT_FALSE(filter.is_new(FlushQueue::in, now + milliseconds(9)));
  EXPECT_TRUE(filter.is_new(FlushQueue::both, now + milliseconds(9)));
  EXPECT_FALSE(filter.is_new(FlushQueue::out, now + milliseconds(9)));
  filter.on_bytes();
  EXPECT_TRUE(filter.is_new(FlushQueue::out, now + milliseconds(9)));
}

// One of the input only, then one of both: that is told for the output, and counts for the input too.
TEST(RepeatFilter, AFlushOfBothQueuesIsOneOfEach) {
  RepeatFilter filter;
  const Instant now{};
  EXPECT_TRUE(filter.is_new(FlushQueue::in, now));
  EXPECT_TRUE(filter.is_new(FlushQueue::both, now + milliseconds(9)));
  EXPECT_FALSE(filter.is_new(FlushQueue::in, now + milliseconds(18)));
  EXPECT_FALSE(filter.is_new(FlushQueue::out, now + milliseconds(18)));
  EXPECT_TRUE(filter.is_new(FlushQueue::in, now + milliseconds(19)));
}

TEST(RepeatFilter, AFloodOfFlushesIsOneEachTenMilliseconds) {
  RepeatFilter filter;
  int news = 0;
  for (int i = 0; i < 10'000; ++i)
    news += filter.is_new(FlushQueue::both, Instant{} + i * Nanos(10'000)) ? 1 : 0;
  EXPECT_EQ(news, 10);
  filter.begin_session();
  EXPECT_TRUE(filter.is_new(FlushQueue::in, Instant{} + milliseconds(100)));
}

}  // namespace
}  // namespace porttape
