#include "libport/rules/toml_table.hpp"

#include <array>
#include <string>
#include <string_view>

#include <gtest/gtest.h>

namespace porttape {
namespace {

using namespace std::string_view_literals;

class TomlTableTest : public testing::Test {
 protected:
  // The whole file is the table.
  TomlTable read(const std::string& text) {
    parsed = parse_toml(text, "my.rules");
    EXPECT_TRUE(parsed.succeeded()) << text;
    return {parsed.table(), "[[rule]] 'it'", problems};
  }
  std::string told() { return problems.any() ? problems.error().message : "nothing"; }

  toml::parse_result parsed;
  Problems problems{"my.rules"};
};

TEST_F(TomlTableTest, GivesWhatIsThereAndNothingElse) {
  TomlTable table = read(
      "text = 'a'\nwhole = 7\nhalf = 0.5\non = true\nword = 'two'\nrange = [1, 2.5]\nplain = 'ab'\n"
      "other_hex = '0a 0B'\ninner = { key = 1 }\n");
  EXPECT_EQ(table.text("text"), "a");
  EXPECT_EQ(table.integer("whole", 7, 7), 7);
  EXPECT_EQ(table.number("half", 0.5, 0.5), 0.5);
  EXPECT_EQ(table.number("whole", 0, 10), 7.0);
  EXPECT_TRUE(table.flag("on"));
  EXPECT_EQ(table.choice("word", std::array{"one"sv, "two"sv}), 1U);
  EXPECT_EQ(table.range("range"), std::pair(1.0, 2.5));
  EXPECT_EQ(table.bytes("plain"), (Bytes{Byte{'a'}, Byte{'b'}}));
  EXPECT_EQ(table.bytes("other"), (Bytes{Byte{0x0a}, Byte{0x0b}}));
  EXPECT_TRUE(table.has("inner"));
  EXPECT_TRUE(table.is_table("inner"));
  EXPECT_FALSE(table.is_table("text"));
  std::optional<TomlTable> inner = table.table("inner");
  ASSERT_TRUE(inner.has_value());
  EXPECT_EQ(inner->name(), "'inner' of [[rule]] 'it'");
  EXPECT_EQ(inner->integer("key", 0, 1), 1);
  table.no_others();
  inner->no_others();
  EXPECT_FALSE(table.text("absent"));
  EXPECT_FALSE(table.integer("absent", 0, 1));
  EXPECT_FALSE(table.number("absent", 0, 1));
  EXPECT_FALSE(table.flag("absent"));
  EXPECT_FALSE(table.choice("absent", {}));
  EXPECT_FALSE(table.range("absent"));
  EXPECT_FALSE(table.bytes("absent"));
  EXPECT_FALSE(table.hex("absent"));
  EXPECT_FALSE(table.table("absent"));
  EXPECT_EQ(told(), "nothing");
}

TEST_F(TomlTableTest, AValueOfAnotherKindIsToldAndCountsAsAbsent) {
  TomlTable table = read("a = 1\nb = 'x'\nc = 'x'\nd = 1\ne = [1]\nf = ['x', 2]\ng = 1\n");
  EXPECT_FALSE(table.text("a"));
  EXPECT_FALSE(table.integer("b", 0, 9));
  EXPECT_FALSE(table.number("c", 0, 0.5));
  EXPECT_FALSE(table.flag("d"));
  EXPECT_FALSE(table.range("e"));
  EXPECT_FALSE(table.range("f"));
  EXPECT_FALSE(table.table("g"));
  EXPECT_EQ(
      told(),
      "my.rules:1: key 'a' of [[rule]] 'it' is of the kind integer; accepted: text in quotes\n"
      "my.rules:2: key 'b' of [[rule]] 'it' is of the kind string; accepted: a whole number from 0 to 9\n"
      "my.rules:3: key 'c' of [[rule]] 'it' is of the kind string; accepted: a number from 0 to 0.5\n"
      "my.rules:4: key 'd' of [[rule]] 'it' is of the kind integer; accepted: true, false\n"
      "my.rules:5: key 'e' of [[rule]] 'it' is of the kind array; accepted: two numbers, [least, most]\n"
      "my.rules:6: key 'f' of [[rule]] 'it' is of the kind array; accepted: two numbers, [least, most]\n"
      "my.rules:7: key 'g' of [[rule]] 'it' is of the kind integer; accepted: a table, { … }");
}

TEST_F(TomlTableTest, NumbersLieBetweenTheirBounds) {
  TomlTable table = read("low = 0\nhigh = 3\nless = 0.4\nmore = 0.6\n");
  EXPECT_FALSE(table.integer("low", 1, 2));
  EXPECT_FALSE(table.integer("high", 1, 2));
  EXPECT_FALSE(table.number("less", 0.5, 0.5));
  EXPECT_FALSE(table.number("more", 0.5, 0.5));
  EXPECT_EQ(table.integer("low", 0, 2), 0);
  EXPECT_EQ(table.integer("high", 1, 3), 3);
  EXPECT_EQ(told(),
            "my.rules:1: key 'low' of [[rule]] 'it' is 0; accepted: a whole number from 1 to 2\n"
            "my.rules:2: key 'high' of [[rule]] 'it' is 3; accepted: a whole number from 1 to 2\n"
            "my.rules:3: key 'less' of [[rule]] 'it' is 0.4; accepted: a number from 0.5 to 0.5\n"
            "my.rules:4: key 'more' of [[rule]] 'it' is 0.6; accepted: a number from 0.5 to 0.5");
}

TEST_F(TomlTableTest, ARangeRisesOrIsOneNumber) {
  TomlTable table = read("down = [2, 1]\none = [1, 1]\n");
  EXPECT_EQ(table.range("one"), std::pair(1.0, 1.0));
  EXPECT_FALSE(table.range("down"));
  EXPECT_EQ(told(), "my.rules:1: key 'down' of [[rule]] 'it' is [2, 1]; accepted: the smaller number first");
}

TEST_F(TomlTableTest, AWordThatIsNotOneOfThemIsToldWithTheNearest) {
  TomlTable table = read("word = 'lettres'\n");
  EXPECT_FALSE(table.choice("word", std::array{"digits"sv, "letters"sv}));
  EXPECT_EQ(told(),
            "my.rules:1: key 'word' of [[rule]] 'it' is 'lettres'; accepted: digits, letters; did you "
            "mean 'letters'?");
}

TEST_F(TomlTableTest, BytesInHexAreWholeAndNotBesidesText) {
  TomlTable table = read("a_hex = '0'\nb_hex = ''\nc_hex = 'xy'\nd = 'x'\nd_hex = '30'\n");
  EXPECT_FALSE(table.bytes("a"));
  EXPECT_FALSE(table.bytes("b"));
  EXPECT_FALSE(table.bytes("c"));
  EXPECT_EQ(table.bytes("d"), Bytes{Byte{0x30}});
  EXPECT_EQ(
      told(),
      "my.rules:1: key 'a_hex' of [[rule]] 'it' is '0'; accepted: two hexadecimal digits for each byte\n"
      "my.rules:2: key 'b_hex' of [[rule]] 'it' is ''; accepted: two hexadecimal digits for each byte\n"
      "my.rules:3: key 'c_hex' of [[rule]] 'it' is 'xy'; accepted: two hexadecimal digits for each byte\n"
      "my.rules:4: key 'd' of [[rule]] 'it' is there besides 'd_hex'; accepted: one of them");
}

TEST_F(TomlTableTest, KeysThatNobodyAskedForAreTold) {
  TomlTable table = read("\ntext = 'a'\ntxet = 'b'\nread_elsewhere = 1\n");
  (void)table.text("text");
  table.asks("read_elsewhere");
  table.no_others();
  EXPECT_EQ(told(), "my.rules:3: [[rule]] 'it' has no key 'txet'; did you mean 'text'?");
}

TEST_F(TomlTableTest, WhatIsWrongIsToldByItsLine) {
  TomlTable table = read("\n\na = 1\n");
  table.wrong("a", "is silly");
  table.wrong("b", "is missing");
  table.set_name("the file");
  table.wrong("as a whole is silly");
  EXPECT_EQ(table.line_of("a"), 3U);
  EXPECT_EQ(table.line_of("b"), table.line());
  EXPECT_EQ(told(),
            "my.rules:1: key 'b' of [[rule]] 'it' is missing\n"
            "my.rules:1: the file as a whole is silly\n"
            "my.rules:3: key 'a' of [[rule]] 'it' is silly");
}

TEST(TomlProblems, TwentyAreToldAndTheRestAreCounted) {
  Problems twenty("f");
  for (std::size_t n = 0; n < 20; ++n) twenty.tell(n, "x");
  EXPECT_TRUE(twenty.error().message.ends_with("\nf:19: x"));
  twenty.tell(20, "x");
  EXPECT_TRUE(twenty.error().message.ends_with("\nf:19: x\nand 1 more of the kind"))
      << twenty.error().message;
  EXPECT_EQ(twenty.error().code, Errc::usage);
}

TEST(TomlProblems, AreForATerminal) {
  Problems problems("f\x1b[2J");
  problems.tell(1, "x\x07");
  EXPECT_EQ(problems.error().message, "f\\x1b[2J:1: x\\x07");
}

TEST(ParseToml, LettersOutsideTextAreRefused) {
  for (const char* const text : {"ä = 1", "a = ä", "a = 1 ä", "[ä]", "a'b' = 1", "a = 1'"})
    EXPECT_FALSE(parse_toml(text, "f").succeeded()) << text;
}

TEST(ParseToml, LettersInTextAndCommentsAreTaken) {
  for (const char* const text :
       {"a = 'ä'", "a = \"ä\"", "# ä", "a = 1 # ä", "a = '''ä\nö'''", "a = \"\"\"ä\n\\\" ö\"\"\"",
        "\xEF\xBB\xBF"
        "a = 1",
        "\xEF\xBB\xBF"
        "'ä' = 1",
        "a = \"\\\"ä\"", "a.'ä' = 1", "a = ['ä','ö']", "a = {b='ä'}"})
    EXPECT_TRUE(parse_toml(text, "f").succeeded()) << text;
}

TEST(ParseToml, ATextThatDoesNotEndIsRefusedWhateverFollows) {
  for (const char* const text : {"a = 'x\nb = 1", "a = \"x\nb = 'ä'", "a = '''x", "a = \"\"\"x\\", "a = '"})
    EXPECT_FALSE(parse_toml(text, "f").succeeded()) << text;
}

}  // namespace
}  // namespace porttape
