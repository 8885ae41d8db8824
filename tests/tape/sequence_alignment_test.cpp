#include "libport/tape/sequence_alignment.hpp"

#include <algorithm>
#include <random>
#include <string_view>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace porttape {
namespace {

using testing::ElementsAre;
using Elements = std::vector<std::uint64_t>;

Elements letters(std::string_view text) { return {text.begin(), text.end()}; }

std::vector<std::uint32_t> align(const Elements& one, const Elements& other,
                                 HardRanges hard = HardRanges::aligned, std::uint64_t steps = 100'000'000) {
  AlignmentEffort effort{steps};
  return align_sequences(one, other, effort, hard);
}

// How many are paired; fails where a pair is none, or not in order.
std::size_t checked(const Elements& one, const Elements& other, const std::vector<std::uint32_t>& partners) {
  EXPECT_EQ(partners.size(), one.size());
  std::int64_t last = -1;
  std::size_t pairs = 0;
  for (std::size_t i = 0; i < partners.size(); ++i) {
    if (partners[i] == kNoPartner) continue;
    EXPECT_GT(std::int64_t{partners[i]}, last);
    EXPECT_EQ(one[i], other.at(partners[i]));
    last = partners[i];
    ++pairs;
  }
  return pairs;
}

std::size_t longest_common(const Elements& one, const Elements& other) {
  std::vector<std::size_t> row(other.size() + 1);
  for (const std::uint64_t each : one) {
    std::size_t diagonal = 0;
    for (std::size_t k = 1; k <= other.size(); ++k) {
      const std::size_t above = row[k];
      row[k] = each == other[k - 1] ? diagonal + 1 : std::max(above, row[k - 1]);
      diagonal = above;
    }
  }
  return row.back();
}

TEST(SequenceAlignment, PairsWhatIsEqualInOrder) {
  constexpr std::uint32_t none = kNoPartner;
  EXPECT_THAT(align(letters("abc"), letters("abc")), ElementsAre(0, 1, 2));
  EXPECT_THAT(align(letters("abc"), letters("ac")), ElementsAre(0, none, 1));
  EXPECT_THAT(align(letters("abcd"), letters("bcda")), ElementsAre(none, 0, 1, 2));
  EXPECT_THAT(align(letters("ab"), letters("")), ElementsAre(none, none));
  EXPECT_THAT(align({}, letters("ab")), ElementsAre());
  EXPECT_THAT(align(letters("xy"), letters("ab")), ElementsAre(none, none));
}

TEST(SequenceAlignment, WhatHasNothingToBePairedWithTakesNoEffort) {
  for (const auto& [one, other] : {std::pair("", "ab"), {"ab", ""}, {"ab", "aab"}, {"aab", "ab"}}) {
    AlignmentEffort effort{100};
    (void)align_sequences(letters(one), letters(other), effort);
    EXPECT_EQ(effort.steps, 100U) << one << " and " << other;
  }
}

TEST(SequenceAlignment, OfShortOnesAsManyAsCanBe) {
  std::mt19937 random(20260201);
  for (int round = 0; round < 2000; ++round) {
    const auto make = [&] {
      Elements all(random() % 60);
      for (auto& each : all) each = random() % (2 + static_cast<unsigned>(round) % 9);
      return all;
    };
    const Elements one = make();
    const Elements other = make();
    EXPECT_EQ(checked(one, other, align(one, other)), longest_common(one, other));
  }
}

TEST(SequenceAlignment, WithFewDifferencesAmongManyRepeats) {
  std::mt19937 random(7);
  Elements one(50'000);
  for (auto& each : one) each = random() % 3;
  Elements other = one;
  for (int i = 0; i < 100; ++i)
    other.erase(other.begin() + static_cast<std::ptrdiff_t>(random() % other.size()));
  EXPECT_EQ(checked(one, other, align(one, other)), other.size());
}

TEST(SequenceAlignment, WithMoreDifferencesThanAreLookedForAroundWhatIsUnique) {
  Elements one;
  for (std::uint64_t i = 0; i < 100'000; ++i) one.push_back(i);
  Elements other;
  for (std::uint64_t i = 0; i < 100'000; ++i) {
    if (i % 10 != 3) other.push_back(i);
    if (i % 7 == 2) other.push_back(3 + 10 * (i % 10'000));
  }
  EXPECT_GE(checked(one, other, align(one, other)), 90'000U);
}

TEST(SequenceAlignment, WhereNothingHoldsItTogetherNothingIsPairedOrSomething) {
  std::mt19937 random(8);
  Elements one(30'000);
  Elements other(30'000);
  for (auto& each : one) each = random() % 20;
  for (auto& each : other) each = random() % 20;
  EXPECT_LT(checked(one, other, align(one, other, HardRanges::left)), 100U);
  EXPECT_GT(checked(one, other, align(one, other)), 5'000U);
  EXPECT_GT(checked(one, other, align(one, other, HardRanges::aligned, 0)), 1'000U);
}

TEST(SequenceAlignment, WhatIsUniqueHoldsARangeTogetherThatDiffersMuch) {
  Elements one;
  Elements other;
  for (std::uint64_t i = 0; i < 10'000; ++i) {
    one.push_back(i);
    other.push_back(i ^ 1U);  // each two exchanged
  }
  EXPECT_EQ(checked(one, other, align(one, other, HardRanges::left)), 5'000U);
  EXPECT_EQ(checked(one, other, align(one, other)), 5'000U);
}

}  // namespace
}  // namespace porttape
