#include "libport/catalog/port_guess.hpp"

#include <sys/socket.h>
#include <sys/un.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using testing::HasSubstr;

std::string guess(std::string_view text, LineEnd end = LineEnd::device) {
  return guess_port(text, end).value_or("none");
}
std::string meant(std::string_view text) {
  return "is not a port; did you mean '" + std::string(text) + "'?";
}

TEST(PortGuess, ANameOfADeviceGetsItsFolder) {
  EXPECT_EQ(guess("ttyUSB0"), meant("/dev/ttyUSB0"));
  EXPECT_EQ(guess("ttyACM1,baud=115200"), meant("/dev/ttyACM1,baud=115200"));
  EXPECT_EQ(guess("dev/ttyUSB0"), meant("/dev/ttyUSB0"));
  EXPECT_EQ(guess("serial/by-id/usb-x"), meant("/dev/serial/by-id/usb-x"));
  EXPECT_EQ(guess("pts/3"), meant("/dev/pts/3"));
  EXPECT_THAT(guess("COM3"), HasSubstr("Windows"));
}

TEST(PortGuess, AnAddressIsThatOfTheEndsSocket) {
  EXPECT_EQ(guess("localhost:2000"), meant("tcp:localhost:2000"));
  EXPECT_EQ(guess("[::1]:2000,wait"), meant("tcp:[::1]:2000,wait"));
  EXPECT_EQ(guess("2000"), meant("tcp:127.0.0.1:2000"));
  EXPECT_EQ(guess("2000", LineEnd::driver), meant("tcp-listen:2000"));
  EXPECT_EQ(guess("tcp://10.0.0.5:2112"), meant("tcp:10.0.0.5:2112"));
  EXPECT_EQ(guess("socket://10.0.0.5:2112"), meant("tcp:10.0.0.5:2112"));
  EXPECT_EQ(guess("udp://10.0.0.5:2112"), meant("udp:10.0.0.5:2112"));
}

TEST(PortGuess, APathIsWhatStandsThere) {
  const test::TempDir dir;
  const std::string path = dir / "x";
  EXPECT_EQ(guess(path), meant("serial:" + path));
  EXPECT_EQ(guess(path, LineEnd::driver), meant("pty:" + path));
  EXPECT_EQ(guess("/tmp/../dev/null", LineEnd::driver), meant("serial:/tmp/../dev/null"));
  const UniqueFd fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  ASSERT_LT(path.size(), sizeof address.sun_path);
  path.copy(address.sun_path, path.size());
  ASSERT_EQ(::bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  EXPECT_EQ(guess(path), meant("unix:" + path));
  EXPECT_EQ(guess(path, LineEnd::driver), meant("unix-listen:" + path));
}

TEST(PortGuess, ATapeIsToBePlayed) {
  const test::TempDir dir;
  test::write_file(dir / "laser.logr", {});
  EXPECT_THAT(guess(dir / "laser"), HasSubstr("is a tape, not a port; to play it: porttaped replay --tape"));
  EXPECT_FALSE(looks_like_port(dir / "laser"));
}

TEST(PortGuess, WhatNamesATypeIsLeftToItsOwnErrors) {
  for (const char* text :
       {"", "tcp:x", "serial", "serail:/dev/x", "/dev/ttyUSB0", "type=x", "word", "modem:x"})
    EXPECT_EQ(guess(text), "none") << text;
  EXPECT_EQ(guess("device=/dev/x,baud=1"), meant("type=serial,device=/dev/x,baud=1"));
}

TEST(PortGuess, ASpeedBehindADeviceIsItsOption) {
  for (const char* text :
       {"/dev/ttyUSB0:9600", "/dev/ttyUSB0 9600", "/dev/ttyUSB0@9600", "serial:/dev/ttyUSB0,9600"})
    EXPECT_EQ(with_speed(text), "/dev/ttyUSB0,baud=9600") << text;
  for (const char* text :
       {"/dev/ttyUSB0", "/dev/ttyUSB0,baud=9600", "/dev/serial/by-path/usb-0:1", "tcp:h:5", ""})
    EXPECT_EQ(with_speed(text), std::nullopt) << text;
}

TEST(PortGuess, WhatIsAPortIsMeant) {
  EXPECT_EQ(meant_port("tcp:h:1", LineEnd::driver), "tcp:h:1");
  EXPECT_EQ(meant_port("ttyUSB0", LineEnd::device), "/dev/ttyUSB0");
  EXPECT_EQ(meant_port("word", LineEnd::device), "");
}

TEST(PortGuess, WhatLooksLikeAPort) {
  for (const char* text : {"/dev/ttyUSB0", "pty:/tmp/x", "ttyUSB0", "COM3", "localhost:1"})
    EXPECT_TRUE(looks_like_port(text)) << text;
  for (const char* text : {"laser.log", "x", ""}) EXPECT_FALSE(looks_like_port(text)) << text;
}

}  // namespace
}  // namespace porttape
