#include "libport/formats/umockdev_format.hpp"

#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/formats/convert_tape.hpp"
#include "tests/support/random_tape.hpp"

namespace porttape {
namespace {

using test::exported;
using test::MemoryTape;
using test::told_lines;
using testing::ElementsAre;
using testing::HasSubstr;

class UmockdevFormatTest : public testing::Test {
 protected:
  Result<ImportedTape> import(std::string_view script) {
    return test::imported(dir, "t" + std::to_string(++made_), "umockdev", script);
  }
  TapePaths tape(const MemoryTape& records) {
    return test::write_tape(literal_tape(dir / ("s" + std::to_string(++made_))), records);
  }
  test::TempDir dir;

 private:
  int made_ = 0;
};

TEST_F(UmockdevFormatTest, ToItsMillisecondBothWays) {
  const std::string text = exported(
      tape(MemoryTape().open(0).write(1'999, "AT\r").read(3'000, std::string("^ \x00\x1e\xff\n", 6))),
      "umockdev");
  EXPECT_EQ(text, "w 1 AT^M\nr 2 ^` ^@^^\xff^J\n");
  EXPECT_EQ(detect_format(text, ""), find_format("umockdev"));
  EXPECT_THAT(told_lines(import(text)), ElementsAre("w 1000 AT\\r", "r 3000 ^ \\x00\\x1e\\xff\\n"));
}

TEST_F(UmockdevFormatTest, WhatAScriptHasBesides) {
  const std::string script = "# c\nd 0 /dev/ttyUSB0\nf 20 -\nw 0 a\nr 0 b\nw 0 c\nr 7 \nQ\nnotes\n";
  EXPECT_THAT(told_lines(import(script)), ElementsAre("w 0 a", "r 0 b", "w 1 c", "r 7000 "));
  EXPECT_EQ(detect_format("d 0 /dev/ttyUSB0\nw 0 a\n", ""), find_format("umockdev"));
}

TEST_F(UmockdevFormatTest, WhatIsWrongIsToldWithItsPlace) {
  const auto error_of = [&](const char* script) { return import(script).error().message; };
  EXPECT_THAT(error_of("w 0 ab^\n"), HasSubstr("evidence:1:7: a ^"));
  EXPECT_THAT(error_of("w 0 a\nw now a\n"), HasSubstr("evidence:2:1: an operation"));
  EXPECT_THAT(error_of("x 0 a\n"), HasSubstr("evidence:1:1: the operation is unknown"));
  EXPECT_THAT(error_of("w 4294967295000 a\nw 1 a\n"), HasSubstr("136 years"));
}

TEST_F(UmockdevFormatTest, AScriptOfATapeComesBackAsItIs) {
  for (unsigned seed = 0; seed < 50; ++seed) {
    std::mt19937 random(seed);
    const auto choose = [&](std::uint32_t n) {
      return n == 0 ? 0U : static_cast<std::uint32_t>(random()) % n;
    };
    const std::string text = exported(tape(test::random_tape(choose, {.sessions = true})), "umockdev");
    const auto back = import(text);
    ASSERT_TRUE(back) << back.error().message;
    EXPECT_EQ(exported(back->paths, "umockdev"), text) << "seed " << seed;
  }
}

}  // namespace
}  // namespace porttape
