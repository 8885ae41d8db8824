#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/formats/read_log.hpp"

namespace porttape {
namespace {

using test::exported;
using test::read_log;
using test::TempDir;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;

TEST(Umockdev, ToItsMillisecondBothWays) {
  const TempDir dir;
  const TapePaths tape = test::write_tape(
      literal_tape(dir / "t"),
      test::MemoryTape().open(0).write(1'999, "AT\r").read(3'000, std::string("^ \x00\x1e\xff\n", 6)));
  std::vector<std::string> lost;
  const std::string text = exported(tape, "umockdev", &lost);
  EXPECT_EQ(text, "w 1 AT^M\nr 2 ^` ^@^^\xff^J\n");
  EXPECT_THAT(lost, ElementsAre("times below a millisecond", "events"));
  EXPECT_EQ(test::detected(text), "umockdev");
  EXPECT_THAT(read_log(dir, "umockdev", text).lines,
              ElementsAre("w 1000 AT\\r", "r 3000 ^ \\x00\\x1e\\xff\\n"));
  EXPECT_THAT(read_log(dir, "umockdev", "# c\nd 0 /dev/ttyUSB0\nf 20 -\nw 0 a\nQ\nnotes\n").lines,
              ElementsAre("w 0 a"));
  EXPECT_THAT(read_log(dir, "umockdev", "w 0 a^\n").error, HasSubstr("evidence:1:6: a ^"));
  EXPECT_THAT(read_log(dir, "umockdev", "w now a\n").error, HasSubstr("evidence:1:1: an operation"));
}

TEST(Gpsd, CommentsAndTheReceiver) {
  const TempDir dir;
  const char* const log = "# Name: x\n# Submitted-by: y\n# Serial: 4800 8N1\n$GPGGA,1*00\r\n# note\n\x01#\n";
  EXPECT_EQ(test::detected(log), "gpsd");
  const auto tape = read_log(dir, "gpsd", log);
  EXPECT_THAT(tape.lines,
              ElementsAre(HasSubstr("\"baud\":4800"), "r 27083 $GPGGA,1*00\\r\\n", "r 33333 \\x01#\\n"));
  EXPECT_THAT(tape.guesses, Contains(HasSubstr("rate that the log tells")));
  const std::string back = exported(literal_tape(dir / "imported"), "gpsd");
  EXPECT_THAT(back, HasSubstr("# Serial: 4800 8N1\n$GPGGA,1*00\r\n\x01#\n"));
}

}  // namespace
}  // namespace porttape
