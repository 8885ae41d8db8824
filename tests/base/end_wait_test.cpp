#include "libport/base/end_wait.hpp"

#include <chrono>

#include <gtest/gtest.h>

namespace porttape {
namespace {

using std::chrono::seconds;

struct EndWaitTest : testing::Test {
  const Instant start{};
  EndWait wait{start, seconds(5)};
};

TEST_F(EndWaitTest, GoesOnWhileSomethingIsRead) {
  for (int n = 0; n < 100; ++n) EXPECT_TRUE(wait.goes_on(start + seconds(4 * n), 1000 - n)) << n;
}

TEST_F(EndWaitTest, EndsWhereNothingIsRead) {
  EXPECT_TRUE(wait.goes_on(start, 1000));
  EXPECT_TRUE(wait.goes_on(start + seconds(4), 900));
  EXPECT_TRUE(wait.goes_on(start + seconds(8), 900));
  EXPECT_FALSE(wait.goes_on(start + seconds(9), 900));
}

TEST_F(EndWaitTest, WhatComesBackIsNoProgress) {
  EXPECT_TRUE(wait.goes_on(start, 900));
  EXPECT_TRUE(wait.goes_on(start + seconds(3), 1000));
  EXPECT_FALSE(wait.goes_on(start + seconds(6), 950));
}

TEST_F(EndWaitTest, WhatIsGivenMoreIsProgressAndCountsAsLeft) {
  EXPECT_TRUE(wait.goes_on(start, 100));
  EXPECT_TRUE(wait.goes_on(start + seconds(4), 0));
  wait.more_given(start + seconds(4), 500);
  EXPECT_TRUE(wait.goes_on(start + seconds(8), 499));
  EXPECT_TRUE(wait.goes_on(start + seconds(12), 499));
  EXPECT_FALSE(wait.goes_on(start + seconds(13), 499));
}

TEST_F(EndWaitTest, HasItsLimitInAllWhereNothingIsKnown) {
  EXPECT_TRUE(wait.goes_on(start + seconds(4), std::nullopt));
  EXPECT_FALSE(wait.goes_on(start + seconds(5), std::nullopt));
}

}  // namespace
}  // namespace porttape
