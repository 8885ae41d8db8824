#include "libport/session/drop_tally.hpp"

#include <gtest/gtest.h>

namespace porttape {
namespace {

TEST(DropTally, TellsPiecesTogetherAndOnce) {
  DropTally tally;
  tally.add(3, "first");
  tally.add(4, "last");
  const auto sum = tally.take();
  ASSERT_TRUE(sum.has_value());
  EXPECT_EQ(sum->bytes, 7U);
  EXPECT_EQ(sum->why, "last");
  EXPECT_FALSE(tally.take().has_value());
}

TEST(DropTally, NoBytesAreNoNews) {
  DropTally tally;
  tally.add(0, "nothing was left");
  EXPECT_FALSE(tally.take().has_value());
}

TEST(DropTally, NoBytesAreNoReason) {
  DropTally tally;
  tally.add(1, "one was left");
  tally.add(0, "nothing was left");
  EXPECT_EQ(tally.take()->why, "one was left");
}

}  // namespace
}  // namespace porttape
