#include "libport/tape/quantiles.hpp"

#include <cstdint>
#include <limits>

#include <gtest/gtest.h>

namespace porttape {
namespace {

constexpr auto kKept = static_cast<std::int64_t>(Quantiles::kExact);

TEST(QuantilesOfFew, AreOfTheNearestRank) {
  Quantiles values;
  for (const std::int64_t value : {30, 10, 20, 40}) values.add(value);
  EXPECT_EQ(values.count(), 4U);
  EXPECT_EQ(values.at(0), 10);
  EXPECT_EQ(values.at(0.25), 10);
  EXPECT_EQ(values.at(0.26), 20);
  EXPECT_EQ(values.at(0.5), 20);
  EXPECT_EQ(values.at(0.75), 30);
  EXPECT_EQ(values.at(0.76), 40);
  EXPECT_EQ(values.at(2), 40);
  EXPECT_EQ(values.min(), 10);
  EXPECT_EQ(values.max(), 40);
}

TEST(QuantilesOfFew, ANegativeValueCountsAsZero) {
  Quantiles values;
  values.add(5);
  values.add(-7);
  EXPECT_EQ(values.min(), 0);
  EXPECT_EQ(values.at(0), 0);
  EXPECT_EQ(values.max(), 5);
}

TEST(QuantilesOfMany, AreExactUpToWhatIsKeptAndThenOfSteps) {
  Quantiles values;
  for (std::int64_t i = 0; i < kKept; ++i) values.add(1'000'000 + i);
  EXPECT_EQ(values.at(0.5), 1'000'000 + kKept / 2 - 1);
  EXPECT_EQ(values.at(1), 1'000'000 + kKept - 1);
  values.add(1'000'000 + kKept);
  EXPECT_EQ(values.count(), static_cast<std::uint64_t>(kKept) + 1);
  // The steps from a million on are 8192 wide and begin at multiples of that.
  EXPECT_EQ(values.at(0.25), 122 * 8192 + 4096);
  EXPECT_EQ(values.at(0.75), 123 * 8192 + 4096);
  EXPECT_EQ(values.at(0.99), values.max()) << "the middle of the last step is beyond";
  EXPECT_EQ(values.at(1), 1'000'000 + kKept);
}

Quantiles many_of(std::int64_t least, std::int64_t value, std::int64_t most) {
  Quantiles values;
  values.add(most);
  values.add(least);
  for (std::int64_t i = 0; i < kKept; ++i) values.add(value);
  return values;
}

TEST(QuantilesOfMany, SmallValuesHaveAStepEach) {
  for (const std::int64_t value : {0, 1, 62, 63, 64, 65, 100, 126, 127})
    EXPECT_EQ(many_of(0, value, 1000).at(0.5), value) << value;
  EXPECT_EQ(many_of(0, 128, 1000).at(0.5), 129);
  EXPECT_EQ(many_of(0, 129, 1000).at(0.5), 129);
  EXPECT_EQ(many_of(0, 255, 1000).at(0.5), 255);
  EXPECT_EQ(many_of(0, 256, 1000).at(0.5), 258);
}

TEST(QuantilesOfMany, AreWithinTheLeastAndTheMost) {
  EXPECT_EQ(many_of(1'000'000, 1'000'000, 1'000'000).at(0.5), 1'000'000);
  EXPECT_EQ(many_of(1'006'000, 1'006'000, 1'008'000).at(0.5), 1'006'000);
  EXPECT_EQ(many_of(5, 9, 1000).at(0), 5);
  EXPECT_EQ(many_of(5, 9, 1000).at(1), 1000);
  EXPECT_EQ(many_of(5, 9, 1000).min(), 5);
}

TEST(QuantilesOfMany, TheLargestNumbersHaveStepsToo) {
  constexpr std::int64_t most = std::numeric_limits<std::int64_t>::max();
  EXPECT_EQ(many_of(0, most - 5, most).at(0.5), most - (std::int64_t{1} << 55) + 1);
}

}  // namespace
}  // namespace porttape
