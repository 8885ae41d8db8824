#include "daemon/config_file.hpp"

#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;

auto read(const std::string& text) {
  std::istringstream in(text);
  return read_config(in, "test.conf");
}

std::string error_of(const std::string& text) {
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

TEST(ConfigFile, ErrorsNameTheFileAndThePlace) {
  EXPECT_THAT(error_of(""), HasSubstr("test.conf"));
  EXPECT_THAT(error_of("device = /dev/x\n"), HasSubstr("[channel NAME]"));
  EXPECT_THAT(error_of("[laser]\ndevice = /dev/x\n"), HasSubstr("laser.device"));
  EXPECT_THAT(error_of("[channel a]\ndevice = /dev/x\ndevice = /dev/y\n"), HasSubstr("twice"));
  EXPECT_THAT(error_of("[channel a]\nnonsense\n"), HasSubstr("'nonsense' is neither"));
  EXPECT_THAT(error_of("[channel a]\n%invalid_line%\n"), HasSubstr("'%invalid_line%' is neither"));
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
