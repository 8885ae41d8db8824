#include "libport/infer/text_parts.hpp"

#include <gtest/gtest.h>

namespace porttape {
namespace {

using Words = std::vector<std::string_view>;

std::string shown(const Words& words) {
  const WordPattern pattern = find_pattern(words);
  for (const auto word : words) EXPECT_TRUE(pattern.matches(word)) << word;
  return pattern.before + "(" + regex_of(pattern) + ")" + pattern.behind;
}

TEST(TextParts, ALineIsCutAtItsMarks) {
  const TextParts parts = cut_text("$PMTK,1.5,,-3*4F\r\n");
  EXPECT_EQ(parts.marks, "$,,,*\r\n");
  EXPECT_EQ(parts.words, (Words{"", "PMTK", "1.5", "", "-3", "4F", "", ""}));
  EXPECT_EQ(cut_text("").words, Words{""});
}

TEST(TextParts, ANumberIsTakenWhole) {
  EXPECT_EQ(shown({"run-123", "run-129"}), "run-([0-9]+)");
  EXPECT_EQ(shown({"T123", "T129", "T1"}), "T([0-9]+)");
  EXPECT_EQ(shown({"24.500", "24.501"}), "([-+.0-9]+)");
  EXPECT_EQ(shown({"p12.-1", "p15.-1"}), "p([0-9]+).-1");
}

TEST(TextParts, TheNarrowestClassIsFound) {
  EXPECT_EQ(shown({"m7fff00", "m7fff0a"}), "m([0-9a-f]+)");
  EXPECT_EQ(shown({"12AB", "12CD"}), "([0-9A-F]+)");
  EXPECT_EQ(shown({"xyz", "uvw"}), "([-+._0-9A-Za-z]+)");
}

TEST(TextParts, FillingZerosFixTheSize) {
  EXPECT_EQ(shown({"0123", "4567"}), "([0-9]{4})");
  EXPECT_EQ(shown({"1123", "4567"}), "([0-9]+)");
  EXPECT_EQ(shown({"0.5", "1.5"}), "([-+.0-9]+)");
}

TEST(TextParts, APartThatMayBeAbsentMayBeEmpty) { EXPECT_EQ(shown({"", "12"}), "([0-9]*)"); }

TEST(TextParts, APatternHoldsToItsEnds) {
  const std::string_view words[] = {"p1a.-1", "p22.-1"};
  const WordPattern pattern = find_pattern(words);
  EXPECT_EQ(pattern.before, "p");
  EXPECT_FALSE(pattern.matches("q22.-1"));
  EXPECT_FALSE(pattern.matches("pzz.-1"));
  EXPECT_FALSE(pattern.matches("p.-1"));
}

}  // namespace
}  // namespace porttape
