#include "libport/formats/gdb_format.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/formats/convert_tape.hpp"

namespace porttape {
namespace {

using test::told_lines;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class GdbFormatTest : public testing::Test {
 protected:
  Result<ImportedTape> import(std::string_view log) {
    return test::imported(dir, "t" + std::to_string(++made_), "gdb", log);
  }
  test::TempDir dir;

 private:
  int made_ = 0;
};

TEST_F(GdbFormatTest, EveryBase) {
  const auto tape = import(
      "\nc target remote :2159\n\nw +$qSupported:a#12\nr +$OK\\\\\\x03\\n<Timeout: 2 seconds>#9a\nEnd of "
      "log\n");
  EXPECT_THAT(tape->problems, IsEmpty());
  EXPECT_THAT(told_lines(tape), ElementsAre("w 0 +$qSupported:a#12", "r 1 +$OK\\\\\\x03\\n#9a"));
  EXPECT_THAT(tape->guesses, ElementsAre(HasSubstr("no times")));
  EXPECT_THAT(told_lines(import("w  2b 24 3f\nr  2b <Eof>\n")), ElementsAre("w 0 +$?", "r 1 +"));
  EXPECT_THAT(told_lines(import("w  053 044\n")), ElementsAre("w 0 +$"));
}

TEST_F(GdbFormatTest, IsToldByItsPackets) {
  for (const char* const log : {"c x\nw +$qSupported#12\n", "w  2b 24 3f\n", "w  053 044\n", "w $#00\n"})
    EXPECT_EQ(detect_format(log, ""), find_format("gdb")) << log;
  EXPECT_EQ(detect_format("w what\n", ""), nullptr);
}

TEST_F(GdbFormatTest, ABreakIsThatOfWhoSentIt) {
  EXPECT_THAT(told_lines(import("w $#00\nw <Break>\n")),
              ElementsAre("w 0 $#00", R"({"t_us":1,"event":"break","state":"on","by":"driver"})",
                          R"({"t_us":1,"event":"break","state":"off","by":"driver"})"));
}

TEST_F(GdbFormatTest, WhatIsNoneIsTold) {
  const auto tape = import("w a\nnoise\nw \\q\nr  zz\n");
  EXPECT_THAT(told_lines(tape), ElementsAre("w 0 a"));
  EXPECT_THAT(tape->problems,
              ElementsAre("line 2: not gdb's; left out", "lines 3 and 4: bytes are damaged; left out"));
}

}  // namespace
}  // namespace porttape
