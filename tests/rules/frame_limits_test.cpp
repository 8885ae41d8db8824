// Frames that are as long as they may be, and those that are a byte longer; what is told of short ones.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "libport/rules/checksum.hpp"
#include "libport/rules/frame_command.hpp"
#include "libport/rules/frame_place.hpp"
#include "libport/rules/frame_stream.hpp"
#include "libport/rules/framing.hpp"

namespace porttape {
namespace {

using namespace std::string_literals;
using State = FrameCut::State;

FrameCut cut_of(std::string_view protocol, std::string_view bytes, bool ended = true) {
  return cut_frame(protocol_formats(protocol), as_bytes(bytes), ended);
}

// The bytes of the first frame; 0: it begins with none.
std::size_t frame_size(std::string_view protocol, std::string_view bytes) {
  const FrameCut cut = cut_of(protocol, bytes);
  return cut.state == State::frame ? cut.size : 0;
}

std::string filled(const std::string& begin, std::size_t size, const std::string& end) {
  return begin + std::string(size - begin.size() - end.size(), 'x') + end;
}

TEST(FrameLimits, AFrameOfAProtocolIsAsLongAsItMayBe) {
  const std::vector<std::pair<std::string, std::size_t>> known = {
      {"nmea", 1024}, {"modbus-ascii", 513}, {"scip", 4096}, {"gdb", 65536}};
  for (const auto& [protocol, most] : known) {
    const std::string begin = protocol == "nmea" || protocol == "gdb" ? "$"
                              : protocol == "modbus-ascii"            ? ":"
                                                                      : "";
    const std::string end = protocol == "gdb" ? "#00" : protocol == "scip" ? "\n" : "\r\n";
    EXPECT_EQ(frame_size(protocol, filled(begin, most, end)), most) << protocol;
    EXPECT_EQ(frame_size(protocol, filled(begin, most + 1, end)), 0U) << protocol;
  }
  EXPECT_EQ(frame_size("modbus-rtu", std::string(256, 'x')), 256U);
  EXPECT_EQ(frame_size("modbus-rtu", std::string(257, 'x')), 0U);
}

TEST(FrameLimits, ALengthSaysAtMostHowLongAFrameMayBe) {
  const std::string rest(5000, 'x');
  EXPECT_EQ(frame_size("modbus-tcp", "\0\1\0\0\x00\xfe"s + rest), 260U);
  EXPECT_EQ(frame_size("modbus-tcp", "\0\1\0\0\x00\xff"s + rest), 0U);
  EXPECT_EQ(frame_size("ubx", "\xb5\x62\x01\x02\xf8\x0f"s + rest), 4096U);
  EXPECT_EQ(frame_size("ubx", "\xb5\x62\x01\x02\xf9\x0f"s + rest), 0U);
  EXPECT_EQ(frame_size("mavlink", "\xfe\xff"s + rest), 263U);
  EXPECT_EQ(frame_size("mavlink", "\xfd\xff\x00"s + rest), 267U);
  EXPECT_EQ(frame_size("mavlink", "\xfd\xff\x01"s + rest), 280U) << "signed";
}

TEST(FrameLimits, ADelimitedFrameIsWaitedForUpToItsLongest) {
  const FrameFormat format{
      .kind = FrameFormat::Kind::delimited, .start = {'$'}, .end = {'#'}, .trailer = 1, .longest = 5};
  const auto state = [&](std::string_view bytes) {
    const FrameCut cut = cut_frame(format, as_bytes(bytes), false);
    return cut.state == State::frame  ? "frame of " + std::to_string(cut.size)
           : cut.state == State::more ? "more"
                                      : "none";
  };
  EXPECT_EQ(state("$abc"), "more");
  EXPECT_EQ(state("$abcd"), "none");
  EXPECT_EQ(state("$ab#"), "more");
  EXPECT_EQ(state("$ab#1"), "frame of 5");
  EXPECT_EQ(state("$abc#"), "none") << "what trails the end would be the sixth byte";
}

// As the rules say it, each place by itself.
FrameCut delimited_by_hand(const FrameFormat& format, std::string_view bytes, bool ended) {
  const std::string_view start = as_text(format.start);
  const std::string_view end = as_text(format.end);
  if (bytes.substr(0, start.size()) != start.substr(0, bytes.size())) return {};
  if (bytes.size() < start.size()) return {ended ? State::none : State::more};
  const std::size_t found = bytes.substr(0, format.longest).find(end, start.size());
  if (found == std::string_view::npos)
    return {ended || bytes.size() >= format.longest ? State::none : State::more};
  const std::size_t size = found + end.size() + format.trailer;
  if (size > format.longest) return {};
  if (size > bytes.size()) return {ended ? State::none : State::more};
  return {State::frame, size};
}

FrameCut cut_by_hand(const std::vector<FrameFormat>& formats, std::string_view bytes, bool ended) {
  const auto at = [&](std::size_t place) {
    for (std::size_t i = 0; i < formats.size(); ++i) {
      FrameCut cut = delimited_by_hand(formats[i], bytes.substr(place), ended);
      cut.format = static_cast<int>(i);
      if (cut.state != State::none) return cut;
    }
    return FrameCut{};
  };
  FrameCut cut = at(0);
  if (cut.state != State::none) return cut;
  cut.size = 1;
  while (cut.size < std::min<std::size_t>(bytes.size(), 256) && at(cut.size).state == State::none) ++cut.size;
  return cut;
}

TEST(FrameLimits, EachPlaceIsJudgedAsIfItWereTheOnlyOne) {
  std::mt19937 random(1);
  const auto up_to = [&](std::size_t most) { return static_cast<std::size_t>(random() % (most + 1)); };
  const auto letters = [&](std::size_t size) {
    Bytes bytes(size);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>("aab$"[random() % 4]);
    return bytes;
  };
  std::size_t frames = 0;
  for (int round = 0; round < 20'000; ++round) {
    std::vector<FrameFormat> formats(1 + up_to(2));
    for (FrameFormat& format : formats) {
      format.start = letters(up_to(3));
      format.end = letters(1 + up_to(3));
      format.trailer = up_to(2);
      format.longest = 1 + up_to(30);
    }
    const Bytes bytes = letters(1 + up_to(40));
    const bool ended = up_to(1) == 1;
    const FrameCut expected = cut_by_hand(formats, as_text(bytes), ended);
    ASSERT_EQ(cut_frame(formats, bytes, ended), expected) << "round " << round << ": " << as_text(bytes);
    frames += expected.state == State::frame ? 1 : 0;
  }
  EXPECT_GT(frames, 1000U);
}

// A search of its own for each beginning would look at 10^12 bytes.
TEST(FrameLimits, ManyBeginningsWithoutAnEndCostNoMoreThanOthers) {
  FrameStream stream(
      {{.kind = FrameFormat::Kind::delimited, .start = {'$'}, .end = {'$', '$', '\r'}, .longest = 65536}});
  std::size_t loose = 0;
  const auto count = [&](int format, ByteView bytes) {
    EXPECT_EQ(format, -1);
    loose += bytes.size();
  };
  const Bytes piece(std::size_t{1} << 20, '$');
  for (int i = 0; i < 16; ++i) stream.add(piece, count);
  stream.end(count);
  EXPECT_EQ(loose, 16 * piece.size());
}

TEST(FrameLimits, AFixedFrameIsNoLongerThanFramesMayBe) {
  FrameFormat format{.kind = FrameFormat::Kind::fixed, .size = 3, .longest = 3};
  EXPECT_EQ(cut_frame(format, as_bytes("abc"), false).state, State::frame);
  format.longest = 2;
  EXPECT_EQ(cut_frame(format, as_bytes("abc"), false).state, State::none);
}

TEST(FrameLimits, ABeginningWithoutMoreIsNoFrame) {
  EXPECT_EQ(cut_of("ubx", "\xb5", false).state, State::more);
  EXPECT_EQ(cut_of("ubx", "\xb5", true).state, State::none);
  EXPECT_EQ(cut_of("ubx", "\xb5\x62\x01", true).state, State::none);
}

TEST(FrameLimits, OfWhatIsNoFrame256BytesAreTakenTogether) {
  for (const std::size_t bytes : {255U, 256U, 257U, 300U})
    EXPECT_EQ(cut_of("ubx", std::string(bytes, 'x')).size, std::min<std::size_t>(bytes, 256)) << bytes;
}

TEST(FrameLimits, TheShortestPauseOfAllFormatsEndsAFrame) {
  const auto pause_of = [](std::vector<Micros> pauses) {
    std::vector<FrameFormat> formats(1);  // a delimited one, which has none
    for (const Micros pause : pauses) formats.push_back({.kind = FrameFormat::Kind::idle, .idle = pause});
    return FrameStream(formats).pause();
  };
  EXPECT_EQ(pause_of({Micros(5000), Micros(3000)}), Micros(3000));
  EXPECT_EQ(pause_of({Micros(3000), Micros(5000)}), Micros(3000));
}

TEST(FrameLimits, ColumnsEndBeforeAChecksumOnlyWhereItStandsAtTheEnd) {
  const Place last{.by = Place::By::column, .column = 1};
  FrameFormat format{.kind = FrameFormat::Kind::length};
  for (const std::int64_t at : {0, 1}) {
    format.checksum = ChecksumField{.kind = "XOR", .at = at};
    EXPECT_EQ(locate(last, nullptr, &format, as_bytes("a,bc")), (FrameSpan{2, 4})) << at;
  }
}

TEST(FrameLimits, AChecksumMayBeOfNothing) {
  const ChecksumField field{.kind = "XOR", .at = 1, .from = 1, .to = 1};
  const FrameChecksum checksum(field, *find_checksum(field.kind));
  EXPECT_EQ(checksum.expected(as_bytes("ab")), (Bytes{0}));
  const ChecksumField reversed{.kind = "XOR", .at = 1, .from = 1, .to = 0};
  EXPECT_EQ(FrameChecksum(reversed, *find_checksum("XOR")).expected(as_bytes("ab")), std::nullopt);
}

std::string command_of(std::string_view protocol, std::string_view frame) {
  const std::vector<FrameFormat> formats = protocol_formats(protocol);
  return frame_command(formats.empty() ? nullptr : formats.data(), as_bytes(frame));
}
std::string word_of(std::string_view text) { return command_of("", text); }

TEST(CommandLimits, AWordIsOfLettersAndADigitsOneOfDigits) {
  EXPECT_EQ(word_of("AZaz@b"), "AZaz");
  EXPECT_EQ(word_of("AZaz[b"), "AZaz");
  EXPECT_EQ(word_of("AZaz`b"), "AZaz");
  EXPECT_EQ(word_of("AZaz{b"), "AZaz");
  EXPECT_EQ(word_of("G09:1"), "G09");
  EXPECT_EQ(word_of("G09/1"), "G09");
  EXPECT_EQ(word_of("GA09"), "GA");
  EXPECT_EQ(word_of("  \t ok"), "ok");
  EXPECT_EQ(word_of("?! 5"), "?!") << "without a letter it ends with the blank";
}

TEST(CommandLimits, AWordIsNoLongerThan24Letters) {
  const std::string letters(24, 'q');
  EXPECT_EQ(word_of(letters), letters);
  EXPECT_EQ(word_of(letters + "q"), letters);
  EXPECT_EQ(command_of("nmea", "$" + letters + "q,1"), letters);
}

TEST(CommandLimits, WhatIsNotPrintableIsShownAsBytes) {
  EXPECT_EQ(word_of("\tAB"), "AB");
  EXPECT_EQ(word_of("AB\r"), "AB");
  EXPECT_EQ(word_of("AB~"), "AB");
  EXPECT_EQ(word_of("AB\x7f"), "41427f");
  EXPECT_EQ(word_of("AB\x08"), "414208");
  EXPECT_EQ(word_of("AB\x0e"), "41420e");
  EXPECT_EQ(word_of("AB\x1f"), "41421f");
  EXPECT_EQ(word_of("AB\x1f\x20"), "41421f20") << "four bytes are shown";
}

TEST(CommandLimits, OfAFrameThatIsCutTheRestCountsAsZero) {
  const std::string_view frame = "\x11\x83";
  EXPECT_EQ(command_of("modbus-rtu", frame), "unit 17 exception 3");
  EXPECT_EQ(command_of("modbus-rtu", frame.substr(0, 1)), "unit 17 function 0");
  EXPECT_EQ(command_of("modbus-ascii", ":1103"), "unit 17 function 3");
  EXPECT_EQ(command_of("modbus-ascii", std::string_view(":1103").substr(0, 4)), "unit 17 function 0");
}

TEST(CommandLimits, NumbersOfMessagesMayHaveThreeBytes) {
  EXPECT_EQ(command_of("mavlink", "\xfd\0\0\0\0\0\0\x03\x02\x01"s), "message 66051");
  EXPECT_EQ(command_of("mavlink", "\xfe\0\0\0\0\xff\1"s), "message 255");
}

TEST(CommandLimits, AFramesBeginningIsNotPartOfItsWord) {
  EXPECT_EQ(command_of("gdb", "$qSupported#37"), "qSupported");
  EXPECT_EQ(command_of("nmea", "$PMTK*32\r\n"), "PMTK");
  EXPECT_EQ(command_of("nmea", "$AB CD\r\n"), "AB CD");
  EXPECT_EQ(command_of("nmea", "$"), "");
  EXPECT_EQ(command_of("nmea", ""), "");
}

}  // namespace
}  // namespace porttape
