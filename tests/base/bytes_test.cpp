#include "libport/base/bytes.hpp"

#include <gtest/gtest.h>

namespace porttape {
namespace {

TEST(Hex, TwoDigitsAByte) { EXPECT_EQ(to_hex(Bytes{0x00, 0x0a, 0xff}), "000aff"); }

TEST(Printable, EscapesWhatATerminalWouldMisread) {
  EXPECT_EQ(to_printable(as_bytes("a\"\\\r\n\t")), R"(a\"\\\r\n\t)");
  EXPECT_EQ(to_printable(Bytes{0x1b, 'x', 0x80}), R"(\x1bx\x80)");
}

TEST(TextAndHex, ShowsTheFirstBytesAndThatThereAreMore) {
  EXPECT_EQ(text_and_hex(as_bytes("AT\r"), 3), R"("AT\r"  41540d)");
  EXPECT_EQ(text_and_hex(as_bytes("AT\r"), 2), R"("AT"...  4154...)");
}

}  // namespace
}  // namespace porttape
