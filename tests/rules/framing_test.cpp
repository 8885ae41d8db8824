#include "libport/rules/framing.hpp"

#include <string>

#include <gtest/gtest.h>

namespace porttape {
namespace {

using namespace std::string_literals;
using State = FrameCut::State;

FrameCut cut(std::string_view protocol, std::string_view bytes, bool ended = false) {
  return cut_frame(protocol_formats(protocol), as_bytes(bytes), ended);
}

TEST(FramingTest, ADelimitedFrameEndsWithItsEndAndWhatTrailsIt) {
  EXPECT_EQ(cut("nmea", "$A*00\r\n$B"), (FrameCut{State::frame, 7, 0}));
  EXPECT_EQ(cut("nmea", "!A*00\r\n"), (FrameCut{State::frame, 7, 1}));
  EXPECT_EQ(cut("nmea", "$A*00\r").state, State::more);
  EXPECT_EQ(cut("nmea", "$A*00\r", true).state, State::none);
  EXPECT_EQ(cut("gdb", "$g#67+").size, 5U);
  EXPECT_EQ(cut("gdb", "$g#6").state, State::more);
}

TEST(FramingTest, WhatIsNoFrameGoesUpToWhereOneMayBegin) {
  EXPECT_EQ(cut("gdb", "+++$g#67"), (FrameCut{State::none, 3, -1}));
  EXPECT_EQ(cut("ubx", "noise\xb5\x62"), (FrameCut{State::none, 5, -1}));
  EXPECT_EQ(cut("ubx", "\xb5x"), (FrameCut{State::none, 2, -1}));
}

TEST(FramingTest, ALengthMayBeOfTheWholeOrOfAPart) {
  EXPECT_EQ(cut("ubx", "\xb5\x62\x01\x02\x02\x00xxcc-"s), (FrameCut{State::frame, 10, 0}));
  EXPECT_EQ(cut("ubx", "\xb5\x62\x01\x02\x02"s).state, State::more);
  EXPECT_EQ(cut("ubx", "\xb5\x62\x01\x02\xff\xff"s).state, State::none) << "longer than frames may be";
  EXPECT_EQ(cut("modbus-tcp", "\x00\x01\x00\x00\x00\x06\x01\x03\x00\x00\x00\x01"s).size, 12U);
  EXPECT_EQ(cut("mavlink", "\xfd\x01\x01\x00\x00\x01\x01\x00\x00\x00"s + std::string(16, 'x')).size, 26U)
      << "signed";
  EXPECT_EQ(cut("mavlink", "\xfd\x01\x00\x00\x00\x01\x01\x00\x00\x00"s + std::string(16, 'x')).size, 13U);
}

TEST(FramingTest, ALengthShorterThanItsOwnHeaderIsNoFrame) {
  const FrameFormat format{.kind = FrameFormat::Kind::length, .length = {.at = 2, .size = 2}};
  EXPECT_EQ(cut_frame(format, as_bytes("ab\x00\x03xx"s), false).state, State::none);
  EXPECT_EQ(cut_frame(format, as_bytes("ab\x00\x04xx"s), false), (FrameCut{State::frame, 4}));
}

TEST(FramingTest, AnIdleFrameEndsWithThePause) {
  EXPECT_EQ(cut("modbus-rtu", "abc").state, State::more);
  EXPECT_EQ(cut("modbus-rtu", "abc", true), (FrameCut{State::frame, 3, 0}));
  EXPECT_EQ(cut("modbus-rtu", std::string(257, 'x'), true).state, State::none);
}

TEST(FramingTest, AFixedFrameIsAsLongAsItIs) {
  const FrameFormat format{.kind = FrameFormat::Kind::fixed, .start = {'a'}, .size = 3};
  EXPECT_EQ(cut_frame(format, as_bytes("abc"), false), (FrameCut{State::frame, 3}));
  EXPECT_EQ(cut_frame(format, as_bytes("ab"), false).state, State::more);
  EXPECT_EQ(cut_frame(format, as_bytes("xbc"), false).state, State::none);
}

TEST(FramingTest, TheFirstFormatThatHasAFrameThereHasIt) {
  std::vector<FrameFormat> formats = protocol_formats("ubx");
  formats.push_back({.kind = FrameFormat::Kind::delimited, .end = {'\n'}});
  EXPECT_EQ(cut_frame(formats, as_bytes("hello\n"), false), (FrameCut{State::frame, 6, 1}));
  EXPECT_EQ(cut_frame(formats, as_bytes("\xb5"), false).state, State::more) << "it may become the first's";
  EXPECT_EQ(cut_frame(formats, as_bytes("\xb5\n"), false), (FrameCut{State::frame, 2, 1}));
}

TEST(FramingTest, EveryNamedProtocolHasFormats) {
  for (const std::string_view name : protocol_names()) EXPECT_FALSE(protocol_formats(name).empty()) << name;
  EXPECT_TRUE(protocol_formats("nme").empty());
}

}  // namespace
}  // namespace porttape
