#include "libport/infer/counters.hpp"

#include <string>

#include <gtest/gtest.h>

namespace porttape {
namespace {

using Texts = std::vector<std::string>;

std::vector<CounterPlace> counters(const std::vector<Texts>& runs) {
  std::vector<FrameRun> views;
  for (const Texts& run : runs) {
    auto& row = views.emplace_back();
    for (const std::string& frame : run) row.push_back(as_bytes(frame));
  }
  return find_counters(views);
}

Texts frames(std::uint32_t first, std::uint32_t count, std::uint32_t step, std::size_t size, bool little) {
  Texts out;
  for (std::uint32_t i = 0; i < count; ++i) {
    std::string number;
    for (std::size_t byte = 0; byte < size; ++byte)
      number += static_cast<char>((first + i * step) >> (8 * (little ? byte : size - 1 - byte)));
    out.push_back("a" + number + "z");
  }
  return out;
}

TEST(Counters, AByteThatWrapsIsOne) {
  EXPECT_EQ(counters({frames(250, 10, 1, 1, false), frames(7, 4, 1, 1, false)}),
            (std::vector<CounterPlace>{{1, 1, false, 1}}));
}

TEST(Counters, WidthAndEndianAreThoseThatExplainTheUpperBytes) {
  EXPECT_EQ(counters({frames(0x11f0, 30, 1, 2, false)}), (std::vector<CounterPlace>{{1, 2, false, 1}}));
  EXPECT_EQ(counters({frames(0x11f0, 30, 3, 2, true)}), (std::vector<CounterPlace>{{1, 2, true, 3}}));
  EXPECT_EQ(counters({frames(0x1111, 5, 1, 2, false), frames(0x2211, 5, 1, 2, false)}),
            (std::vector<CounterPlace>{{1, 2, false, 1}}));
  EXPECT_EQ(counters({frames(5, 5, 1, 2, false)}), (std::vector<CounterPlace>{{2, 1, false, 1}}));
  EXPECT_EQ(counters({frames(0x100'0000, 5, ~0U, 4, false)}), (std::vector<CounterPlace>{{1, 4, false, -1}}));
}

TEST(Counters, WhatJumpsOrStandsStillIsNone) {
  EXPECT_TRUE(counters({{"a1", "a2", "a3", "a5", "a6"}}).empty());
  EXPECT_TRUE(counters({{"a1", "a1", "a1", "a1", "a1"}}).empty());
  EXPECT_TRUE(counters({{"a1", "a2", "a3"}}).empty()) << "too few";
  EXPECT_TRUE(counters({{}, {}}).empty());
}

TEST(Counters, InTextTheyMayGrowLonger) {
  using Runs = std::vector<std::vector<std::string_view>>;
  EXPECT_EQ(find_text_counter(Runs{{"8", "9", "10"}, {"98", "99", "100"}}), (TextCounter{10, 1}));
  EXPECT_EQ(find_text_counter(Runs{{"8", "9", "a", "b", "c"}}), (TextCounter{16, 1}));
  EXPECT_EQ(find_text_counter(Runs{{"8", "9", "11", "12", "13"}}), std::nullopt);
  EXPECT_EQ(find_text_counter(Runs{{"8", "x", "10", "11", "12"}}), std::nullopt);
}

}  // namespace
}  // namespace porttape
