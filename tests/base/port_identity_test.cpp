#include "libport/base/port_identity.hpp"

#include <cctype>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace porttape {
namespace {

using testing::HasSubstr;

std::string refused(const std::string& text) {
  const Result<PortIdentity> parsed = parse_identity(text);
  return parsed ? "accepted" : parsed.error().message;
}

TEST(PortIdentity, IsAPathAlone) {
  const PortIdentity plain = parse_identity("/dev/ttyS0").value();
  EXPECT_EQ(plain, PortIdentity{.path = "/dev/ttyS0"});
  EXPECT_FALSE(plain.is_usb());
  EXPECT_EQ(by_id_name(plain), "");
  EXPECT_EQ(to_text(plain), "/dev/ttyS0");
  EXPECT_EQ(completed(plain), plain);
}

TEST(PortIdentity, HasWhatItsDeviceTells) {
  const PortIdentity port = parse_identity(
                                "/dev/ttyUSB0,vid=0403,pid=0x6001,serial=A6008isP,manufacturer=FTDI,"
                                "product=FT232R USB UART,interface=1,driver=ftdi_sio,location=3-2.4")
                                .value();
  EXPECT_EQ(port.vid, 0x0403);
  EXPECT_EQ(port.pid, 0x6001);
  EXPECT_EQ(port.product, "FT232R USB UART");
  EXPECT_EQ(port.interface, 1);
  EXPECT_EQ(port.location, "3-2.4");
  EXPECT_EQ(to_text(port),
            "/dev/ttyUSB0, USB 0403:6001, serial A6008isP, FTDI FT232R USB UART, interface 1, ftdi_sio");
}

TEST(PortIdentity, WhatIsWrongIsNamed) {
  const std::vector<std::pair<std::string, std::string>> rows = {
      {"", "is not below /dev; accepted: a name below /dev, such as /dev/ttyUSB0"},
      {"ttyUSB0", "port 'ttyUSB0' is not below /dev"},
      {"/dev/", "is not below /dev"},
      {"/tmp/tty", "is not below /dev"},
      {"/dev/../etc/passwd", "has a part that begins with '.'"},
      {"/dev/a//b", "has an empty part"},
      {"/dev/ttyUSB0;touch PWNED;#",
       "has other characters than letters, digits and _.:+@-; accepted: a name below"},
      {"/dev/tty\n", "has control characters"},
      {"/dev/null", "is a name that every program needs as it is"},
      {"/dev/pts/3", "is a name that every program needs as it is"},
      {"/dev/ttyUSB0,", "unknown key ''; accepted: vid, pid"},
      {"/dev/ttyUSB0,vdi=0403",
       "unknown key 'vdi'; accepted: vid, pid, serial, manufacturer, product, "
       "interface, driver, location; did you mean 'vid'?"},
      {"/dev/ttyUSB0,vid", "key 'vid' has no value; accepted: vid=VALUE"},
      {"/dev/ttyUSB0,vid=04031", "'04031' is not four hexadecimal digits; accepted: 0000 to ffff"},
      {"/dev/ttyUSB0,vid=-1,pid=1", "'-1' is not four hexadecimal digits"},
      {"/dev/ttyUSB0,vid=0403", "has a vid and no pid"},
      {"/dev/ttyUSB0,pid=0403", "has a pid and no vid"},
      {"/dev/ttyUSB0,serial=1", "has something of a USB device, and no vid and pid"},
      {"/dev/ttyUSB0,vid=1,pid=1,vid=2", "key 'vid' is given twice"},
      {"/dev/ttyUSB0,vid=1,pid=1,interface=256", "'256' is not a number; accepted: 0 to 255"},
      {"/dev/ttyUSB0,vid=1,pid=1,serial=a\nE:X=1", "has control characters; accepted: a text of one line"},
      {"/dev/ttyUSB0,vid=1,pid=1,driver=../x", "is not a driver's name"},
      {"/dev/ttyUSB0,vid=1,pid=1,location=1-1/..", "is no place on a USB bus; accepted: BUS-PORT"},
      {"/dev/ttyUSB0,vid=1,pid=1,serial=" + std::string(401, 'x'),
       "a text of 401 bytes; accepted: up to 400"}};
  for (const auto& [text, told] : rows) EXPECT_THAT(refused(text), HasSubstr(told)) << text;
}

TEST(PortIdentity, APathHasNoLetterThatAnythingTakesForMore) {
  const std::string allowed = "_.:+@-";
  for (int each = 1; each < 256; ++each) {
    if (each == '/' || each == ',') continue;  // the next part; the next key
    const char letter = static_cast<char>(each);
    const bool plain = each < 128 && (std::isalnum(each) != 0 || allowed.find(letter) != std::string::npos);
    for (const std::string& path :
         {"/dev/a" + std::string(1, letter) + "b", "/dev/a/b" + std::string(1, letter)})
      EXPECT_EQ(refused(path) == "accepted", plain) << each;
  }
}

// As udev 252 names them.
TEST(PortIdentity, IsNamedAsUdevDoes) {
  PortIdentity port{.path = "/dev/ttyUSB0",
                    .vid = 0x0403,
                    .pid = 0x6001,
                    .serial = "A6008isP",
                    .manufacturer = "FTDI",
                    .product = "FT232R USB UART"};
  EXPECT_EQ(by_id_name(port), "usb-FTDI_FT232R_USB_UART_A6008isP-if00-port0");
  port = {.path = "/dev/ttyACM0", .vid = 0x2341, .pid = 0x0043, .interface = std::uint8_t{10}};
  EXPECT_EQ(by_id_name(port), "usb-2341_0043-if0a");
  // What udev takes for no serial number.
  for (const char* serial : {"A,1", "Ger\xc3\xa4t", ""}) {
    port.serial = serial;
    EXPECT_EQ(udev_short_serial(port), "") << serial;
    EXPECT_EQ(by_id_name(port), "usb-2341_0043-if0a") << serial;
  }
  EXPECT_EQ(udev_name("  Silicon   Labs, Inc./\xc3\xa4\xff "), "Silicon_Labs__Inc._\xc3\xa4_");
}

TEST(PortIdentity, WhatIsNotKnownFitsTheRest) {
  PortIdentity port{.path = "/dev/ttyACM0", .vid = 0x2341, .pid = 0x43};
  EXPECT_EQ(completed(port).driver, "cdc_acm");
  EXPECT_EQ(completed(port).location, "1-1");
  EXPECT_EQ(completed(port).interface, 0);
  port = {.path = "/dev/ttyUSB0", .vid = 0x10c4, .pid = 0xea60};
  EXPECT_EQ(completed(port).driver, "cp210x");
}

}  // namespace
}  // namespace porttape
