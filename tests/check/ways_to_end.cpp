// No tests of anything: outcome_test.sh runs them to see how a unit test skips, and how it ends when time was
// its only fault.

#include <chrono>

#include <gtest/gtest.h>

#include "tests/support/time_bound.hpp"

using std::chrono::milliseconds;
using std::chrono::seconds;

TEST(WaysToEnd, Skipped) { GTEST_SKIP() << "no bananas here"; }

TEST(WaysToEnd, InTime) {
  EXPECT_WITHIN(milliseconds(2000), seconds(2));
  EXPECT_WITHIN(2, 3);
  EXPECT_IN_TIME(true);
}

TEST(WaysToEnd, Late) {
  EXPECT_WITHIN(milliseconds(2001), seconds(2)) << "the answer";
  EXPECT_IN_TIME(false) << "a stall";
}

TEST(WaysToEnd, LateAndWrong) {
  EXPECT_WITHIN(milliseconds(2001), seconds(2));
  EXPECT_EQ(1, 2);
}

TEST(WaysToEnd, Wrong) { EXPECT_EQ(1, 2) << "bound of time: it only says so"; }
