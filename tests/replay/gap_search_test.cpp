// Where the tape goes on behind a gap.

#include "libport/replay/gap_search.hpp"

#include <string>

#include <gtest/gtest.h>

#include "libport/base/bytes.hpp"

namespace porttape {
namespace {

using Found = GapSearch::Found;

// So many bytes that are all different.
std::string different(std::size_t count) {
  std::string text;
  for (std::size_t i = 0; i < count; ++i) text += static_cast<char>(i);
  return text;
}

// A driver that writes what the tape has; whether the search still goes on.
bool goes_on_after(std::string_view text) {
  GapSearch search;
  search.begin(1000);
  for (const Byte byte : as_bytes(text)) {
    if (search.active()) {
      EXPECT_EQ(search.take(byte, byte), Found::front);
    }
  }
  return search.active();
}

TEST(GapSearchTest, SixtyFourBytesInARowAreEnough) {
  EXPECT_TRUE(goes_on_after(different(63)));
  EXPECT_FALSE(goes_on_after(different(64)));
}

TEST(GapSearchTest, BytesThatRepeatThemselvesByHalfAreNot) {
  EXPECT_TRUE(goes_on_after(different(32) + different(32)));
  EXPECT_FALSE(goes_on_after(different(33) + different(31)));
}

TEST(GapSearchTest, VeryManyAreEnoughHoweverTheyRepeat) {
  EXPECT_TRUE(goes_on_after(std::string(4095, 'P')));
  EXPECT_FALSE(goes_on_after(std::string(4096, 'P')));
}

TEST(GapSearchTest, AsManyBytesAsTheGapSwallowedMayBeMissing) {
  GapSearch search;
  search.begin(2);
  EXPECT_EQ(search.take('x', 'a'), Found::skipped);
  EXPECT_TRUE(search.astray());
  EXPECT_EQ(search.take('x', 'a'), Found::skipped);
  EXPECT_EQ(search.take('x', 'a'), Found::too_many);
  EXPECT_FALSE(search.active());
  EXPECT_FALSE(search.astray());
}

TEST(GapSearchTest, WhatTheTapeHasMayHaveBeenTheGaps) {
  GapSearch search;
  search.begin(2);
  EXPECT_EQ(search.take('a', 'a'), Found::front);
  EXPECT_EQ(search.take('a', 'b'), Found::retry) << "the first was the gap's";
  EXPECT_EQ(search.take('a', std::nullopt), Found::known);
  EXPECT_TRUE(search.at_front());
  EXPECT_EQ(search.take('b', 'b'), Found::front);
}

TEST(GapSearchTest, AFurtherGapAddsWhatItSwallowed) {
  GapSearch search;
  search.begin(2);
  EXPECT_EQ(search.take('x', 'a'), Found::skipped);
  search.begin(1);
  EXPECT_EQ(search.take('x', 'a'), Found::skipped);
  EXPECT_EQ(search.take('x', 'a'), Found::skipped) << "one was left of the first";
  EXPECT_EQ(search.take('x', 'a'), Found::too_many);
}

}  // namespace
}  // namespace porttape
