#include "libport/rules/frame_stream.hpp"

#include <random>
#include <utility>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/rules/frame_command.hpp"

namespace porttape {
namespace {

using testing::ElementsAre;
using testing::ElementsAreArray;

using Pieces = std::vector<std::pair<int, std::string>>;

Pieces cut_in(const std::vector<FrameFormat>& formats, const std::vector<std::string>& parts) {
  FrameStream stream(formats);
  Pieces found;
  const FrameStream::Visit visit = [&](int format, ByteView bytes) {
    if (format < 0 && !found.empty() && found.back().first < 0) {
      found.back().second += as_text(bytes);
    } else {
      found.emplace_back(format, as_text(bytes));
    }
  };
  for (const std::string& part : parts) stream.add(as_bytes(part), visit);
  stream.end(visit);
  return found;
}

TEST(FrameStream, HowBytesComeDoesNotMatter) {
  const std::string text = "junk$GPGGA,1*2F\r\nmore!AIVDM,2*3C\r\n$GPG";
  std::vector<std::string> bytes;
  for (const char byte : text) bytes.emplace_back(1, byte);
  const Pieces whole = cut_in(protocol_formats("nmea"), {text});
  EXPECT_THAT(whole,
              ElementsAre(std::pair(-1, std::string("junk")), std::pair(0, std::string("$GPGGA,1*2F\r\n")),
                          std::pair(-1, std::string("more")), std::pair(1, std::string("!AIVDM,2*3C\r\n")),
                          std::pair(-1, std::string("$GPG"))));
  EXPECT_THAT(cut_in(protocol_formats("nmea"), bytes), ElementsAreArray(whole));
}

TEST(FrameStream, RandomBytesAreAllTold) {
  std::mt19937 random(7);
  for (int round = 0; round < 200; ++round) {
    std::string all;
    std::vector<std::string> parts;
    for (int part = 0; part < 5; ++part) {
      std::string bytes(random() % 40, ' ');
      for (char& byte : bytes) byte = "\xb5\x62\x01\x02\x00\x05$*\r\n:A"[random() % 12];
      all += bytes;
      parts.push_back(bytes);
    }
    for (const std::string_view protocol : protocol_names()) {
      std::string told;
      for (const auto& [format, bytes] : cut_in(protocol_formats(protocol), parts)) told += bytes;
      EXPECT_EQ(told, all) << protocol;
    }
  }
}

TEST(FrameStream, TellsWhichPauseEndsAFrame) {
  EXPECT_EQ(FrameStream(protocol_formats("nmea")).pause(), std::nullopt);
  EXPECT_EQ(FrameStream(protocol_formats("modbus-rtu")).pause(), Micros(1750));
}

std::string command_in(std::string_view protocol, std::string_view frame) {
  const std::vector<FrameFormat> formats = protocol_formats(protocol);
  return frame_command(formats.empty() ? nullptr : formats.data(), as_bytes(frame));
}

TEST(FrameCommand, OfKnownProtocols) {
  using namespace std::string_view_literals;
  EXPECT_EQ(command_in("nmea", "$GPGGA,123*2F\r\n"), "GPGGA");
  EXPECT_EQ(command_in("ubx", "\xb5\x62\x06\x08\x00\x00"sv), "class 06 message 08");
  EXPECT_EQ(command_in("modbus-rtu", "\x11\x03\x00\x6b"sv), "unit 17 function 3");
  EXPECT_EQ(command_in("modbus-rtu", "\x11\x83\x02"sv), "unit 17 exception 3");
  EXPECT_EQ(command_in("modbus-tcp", "\0\1\0\0\0\6\x0a\x04"sv), "unit 10 function 4");
  EXPECT_EQ(command_in("modbus-ascii", ":1103006B00037E\r\n"), "unit 17 function 3");
  EXPECT_EQ(command_in("mavlink", "\xfd\x09\0\0\x01\x01\x01\x4c\x01\0"sv), "message 332");
  EXPECT_EQ(command_in("mavlink", "\xfe\x09\x01\x01\x01\x4c"sv), "message 76");
}

TEST(FrameCommand, OfTextAndOfBytes) {
  using namespace std::string_view_literals;
  EXPECT_EQ(command_in("scip", "MD0044072501000\n"), "MD");
  EXPECT_EQ(command_in("", "*IDN?\n"), "*IDN");
  EXPECT_EQ(command_in("", "G1 X10 Y20\n"), "G1");
  EXPECT_EQ(command_in("", "M115\n"), "M115");
  EXPECT_EQ(command_in("", "-12.5\r\n"), "(number)");
  EXPECT_EQ(command_in("", "\r\n"), "(empty)");
  EXPECT_EQ(command_in("", "\x01\x02\x03\x04\x05"sv), "01020304...");
  EXPECT_EQ(command_in("", "\x01\x02"sv), "0102");
}

TEST(FrameCommand, OfCutFramesIsStillSome) {
  for (const std::string_view protocol : protocol_names()) {
    for (std::size_t size = 0; size < 4; ++size)
      EXPECT_NE(command_in(protocol, std::string_view("\xb5\x11\x03\x01", size)), "x") << protocol;
  }
}

}  // namespace
}  // namespace porttape
