#include "libport/infer/align.hpp"

#include <string>
#include <string_view>

#include <gtest/gtest.h>

namespace porttape {
namespace {

// "a- bb c-": each column's characters, '-' for none.
std::string aligned(std::vector<std::string_view> texts) {
  std::vector<std::size_t> sizes;
  for (const auto text : texts) sizes.push_back(text.size());
  const auto columns =
      align_all(sizes, [&](std::size_t of_a, std::size_t a, std::size_t of_b, std::size_t b) {
        return texts[of_a][a] == texts[of_b][b] ? 1.0 : 0.0;
      });
  std::string out;
  for (const Column& column : columns) {
    if (!out.empty()) out += ' ';
    for (std::size_t of = 0; of < column.size(); ++of) out += column[of] ? texts[of][*column[of]] : '-';
  }
  return out;
}

TEST(Align, WhatIsAlikeStandsTogetherInOrder) {
  EXPECT_EQ(aligned({"abc", "abc"}), "aa bb cc");
  EXPECT_EQ(aligned({"abc", "ac"}), "aa b- cc");
  EXPECT_EQ(aligned({"ac", "abc"}), "aa -b cc");
  EXPECT_EQ(aligned({"abc", "xyz"}).size(), std::string("a- b- c- -x -y -z").size());
}

TEST(Align, OfRepeatsTheLastOnesStandAlone) {
  EXPECT_EQ(aligned({"ppppq", "ppq"}), "pp pp p- p- qq");
  EXPECT_EQ(aligned({"q", "ppq"}), "-p -p qq");
}

TEST(Align, SeveralSequencesMakeColumns) {
  EXPECT_EQ(aligned({"apq", "aq", "appq"}), "aaa p-p --p qqq");
  EXPECT_EQ(aligned({"", "a", "a"}), "-aa");
  EXPECT_EQ(aligned({}), "");
}

TEST(Align, TheBestSumWinsOverTheFirstMatch) {
  // a1 could go with b0 (weakly) or with b1 (fully).
  const auto pairs = align(1, 2, [](std::size_t, std::size_t b) { return b == 0 ? 0.2 : 1.0; });
  const std::vector<AlignedPair> expected{{std::nullopt, 0}, {0, 1}};
  EXPECT_EQ(pairs, expected);
}

TEST(Align, TooMuchIsRefused) {
  EXPECT_THROW((void)align(kMostCells, 2, [](std::size_t, std::size_t) { return 0.0; }), std::length_error);
}

}  // namespace
}  // namespace porttape
