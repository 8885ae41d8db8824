#include "daemon/config_file.hpp"

#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;
using testing::MatchesRegex;

auto read(const std::string& text) {
  std::istringstream in(text);
  return read_config(in, "test.conf");
}

std::string errors_of(const std::string& text) {
  const auto channels = read(text);
  EXPECT_FALSE(channels.has_value()) << text;
  if (channels) return {};
  EXPECT_EQ(channels.error().code, Errc::usage);
  return channels.error().message;
}

TEST(ConfigFile, TheModeFollowsFromTheKeys) {
  const auto channels = read(
      "# a comment\n"
      "[channel laser]\ndevice = serial:/dev/ttyUSB0,baud=115200\ndriver=pty:/tmp/laser\ntape=laser\n\n"
      "[channel gps]\ntape = gps\ndriver = pty:/tmp/gps\nstrictness = 2\n"
      "[channel plain]\ndevice = /dev/ttyS9\ndriver = pty:/tmp/plain\n");
  ASSERT_TRUE(channels.has_value()) << channels.error().message;
  EXPECT_EQ(channels->at("laser").mode, ChannelMode::record);
  EXPECT_EQ(channels->at("laser").values.at("device"), "serial:/dev/ttyUSB0,baud=115200");
  EXPECT_EQ(channels->at("gps").mode, ChannelMode::replay);
  EXPECT_EQ(channels->at("gps").values.at("strictness"), "2");
  EXPECT_EQ(channels->at("plain").mode, ChannelMode::bridge);
}

TEST(ConfigFile, ChannelNamesMayHaveDots) {
  const auto channels = read("[channel rack.2.laser]\ndevice = /dev/x\ndriver = pty\n");
  ASSERT_TRUE(channels.has_value());
  EXPECT_TRUE(channels->contains("rack.2.laser"));
}

TEST(ConfigFile, CommentsAndSpaceAreNothing) {
  const auto channels = read(
      "\xEF\xBB\xBF; a comment = of the line\r\n[ channel  a ] # the first\r\n"
      "\tdevice=/dev/x # until the end\r\ndriver = pty:/tmp/a;b\r\n");
  ASSERT_TRUE(channels.has_value()) << channels.error().message;
  EXPECT_EQ(channels->at("a").values.at("device"), "/dev/x");
  EXPECT_EQ(channels->at("a").values.at("driver"), "pty:/tmp/a;b");
}

TEST(ConfigFile, ErrorsNameFileAndLine) {
  EXPECT_THAT(errors_of(""), HasSubstr("test.conf:1: there is no section"));
  EXPECT_THAT(errors_of("device = /dev/x\n"), HasSubstr("test.conf:1: 'device' is in no section"));
  EXPECT_THAT(errors_of(std::string("\x7F"
                                    "ELF\0",
                                    5)),
              HasSubstr("test.conf:1: is not text"));
  const std::string good = "driver=pty\ndevice=/dev/x\n";
  EXPECT_THAT(errors_of("\n[channel a]\n" + good + "device = /dev/y\n"),
              HasSubstr("test.conf:5: option 'device' is there twice, first in line 4"));
  EXPECT_THAT(errors_of("[channel a]\n" + good + "[channel a]\n" + good),
              HasSubstr("test.conf:4: channel 'a' is there twice, first in line 1"));
  EXPECT_THAT(errors_of("[channel a]\nnonsense\n"), HasSubstr("test.conf:2: 'nonsense' is neither"));
  EXPECT_THAT(errors_of("[channel a]\n%invalid_line%\n"), HasSubstr("'%invalid_line%' is neither"));
}

TEST(ConfigFile, ASectionOfAnotherNameIsNamedAndItsKeysAreNot) {
  EXPECT_EQ(errors_of("[laser]\ndevice = /dev/x\n"),
            "test.conf:1: '[laser]' is no section; did you mean '[channel laser]'?");
  EXPECT_THAT(errors_of("[chanel laser]\n"), HasSubstr("did you mean '[channel laser]'?"));
  EXPECT_THAT(errors_of("[channel]\n"), HasSubstr("accepted: [channel NAME]"));
}

TEST(ConfigFile, AKeyWithADotIsNoOtherChannel) {
  EXPECT_THAT(errors_of("[channel a]\nb.device=x\ndriver=pty\ndevice=/dev/x\n"),
              HasSubstr("test.conf:2: unknown option 'b.device' of bridge"));
}

TEST(ConfigFile, EverythingThatIsWrongIsToldAtOnceInOrder) {
  EXPECT_EQ(
      errors_of("[channel b]\n"
                "driver = pty:/tmp/b\n"
                "tape = laser\n"
                "strictnes = 2\n"
                "jitter = 5ms\n"
                "[channel a]\n"
                "driver = /tmp/a\n"
                "device = serial:/dev/x,bau=1\n"
                "[channel c]\n"
                "driver = pty:/tmp/../tmp/b\n"),
      "test.conf:4: unknown option 'strictnes' of replay; did you mean 'strictness'?\n"
      "test.conf:5: option 'jitter': '5ms' is not valid; accepted: milliseconds, 0 to 1000000000; did you "
      "mean '5'?\n"
      "test.conf:7: option 'driver': '/tmp/a' is not a port; did you mean 'pty:/tmp/a'?\n"
      "test.conf:8: option 'device': port 'serial:/dev/x,bau=1': unknown option 'bau' of type serial; did "
      "you mean 'baud'?\n"
      "test.conf:9: option 'device' is missing: PORT, where the device is, e.g. /dev/ttyUSB0,baud=115200\n"
      "test.conf:10: link '/tmp/b' is that of channel 'b'; name another");
}

TEST(ConfigFile, ATapeIsOfOneChannel) {
  EXPECT_THAT(errors_of("[channel a]\ndevice=/dev/x\ndriver=pty\ntape=t\n"
                        "[channel b]\ndevice=/dev/y\ndriver=pty\ntape=t.log\n"),
              MatchesRegex("test.conf:8: tape '.*/t.log' is that of channel 'a'; name another"));
}

TEST(ConfigFile, AReportIsOfOneChannelToo) {
  const std::string replays = "driver=pty\ntape=t\nreport=";
  EXPECT_THAT(errors_of("[channel a]\n" + replays + "/r.json\n[channel b]\n" + replays + "/./r.json\n"),
              HasSubstr("test.conf:8: report '/r.json' is that of channel 'a'; name another"));
  EXPECT_TRUE(read("[channel a]\n" + replays + "-\n[channel b]\n" + replays + "-\n").has_value());
}

TEST(ConfigFile, OfWhatIsNoConfigurationTwentyLinesAreTold) {
  std::string text;
  for (int n = 0; n < 100; ++n) text += "word\n";
  EXPECT_THAT(errors_of(text),
              HasSubstr("test.conf:20: 'word' is neither KEY = VALUE nor [channel NAME]\nand 80 "
                        "more of the kind"));
}

TEST(ConfigFile, WhatIsNoTextIsToldAloneWhateverIsWrongBefore) {
  EXPECT_EQ(errors_of(std::string("word\n[channel a]\ndevice = \0x\n", 28)),
            "test.conf:3: is not text; accepted: an INI file, see porttaped run --help");
}

TEST(ConfigFile, ASectionsNameStandsBetweenBothBrackets) {
  const std::string text = errors_of("[channel a\ndevice = /dev/x\n");
  EXPECT_THAT(text, HasSubstr("test.conf:1: '[channel a' is neither KEY = VALUE nor [channel NAME]"));
  EXPECT_THAT(errors_of("[channel a]\ndevice = /dev/x\ndriver = pty\nword]\n"),
              HasSubstr("test.conf:4: 'word]' is neither KEY = VALUE nor [channel NAME]"));
}

TEST(ConfigFile, AFileThatCannotBeReadIsNamed) {
  const test::TempDir dir;
  for (const std::string& path : {dir / "none", dir.path().string()}) {
    const auto channels = read_config_file(path);
    ASSERT_FALSE(channels.has_value());
    EXPECT_THAT(channels.error().message, HasSubstr(path));
  }
}

}  // namespace
}  // namespace porttape
