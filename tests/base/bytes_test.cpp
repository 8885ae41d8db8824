#include "libport/base/bytes.hpp"

#include <gtest/gtest.h>

namespace porttape {
namespace {

TEST(Hex, TwoDigitsAByte) { EXPECT_EQ(to_hex(Bytes{0x00, 0x0a, 0xff}), "000aff"); }

TEST(Printable, EscapesWhatATerminalWouldMisread) {
  EXPECT_EQ(to_printable(as_bytes("a\"\\\r\n\t")), R"(a\"\\\r\n\t)");
  EXPECT_EQ(to_printable(Bytes{0x1b, 'x', 0x80}), R"(\x1bx\x80)");
}

}  // namespace
}  // namespace porttape
