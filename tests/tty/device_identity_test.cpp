// A tree as the kernel shows it, in a folder.

#include "libport/tty/device_identity.hpp"

#include <filesystem>
#include <fstream>
#include <string>

#include <gtest/gtest.h>

#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

class DeviceIdentity : public testing::Test {
 protected:
  void put(const std::string& path, const std::string& text) const {
    fs::create_directories(fs::path(sys / path).parent_path());
    std::ofstream(sys / path) << text << '\n';
  }
  void link(const std::string& path, const std::string& target) const {
    fs::create_directories(fs::path(sys / path).parent_path());
    fs::create_directory_symlink(target, sys / path);
  }
  void usb_device() const {
    put("devices/usb3/3-2.4/idVendor", "0403");
    put("devices/usb3/3-2.4/idProduct", "6001");
    put("devices/usb3/3-2.4/serial", "A6008isP");
    put("devices/usb3/3-2.4/manufacturer", "FTDI");
    put("devices/usb3/3-2.4/product", "FT232R\tUART ");
    put("devices/usb3/3-2.4/3-2.4:1.0/bInterfaceNumber", "0a");
  }
  [[nodiscard]] std::optional<PortIdentity> identity(const std::string& device) const {
    return identity_of(device, fs::path(sys / "").string());
  }

  test::TempDir sys;
};

TEST_F(DeviceIdentity, OfAPortOfUsbSerial) {
  usb_device();
  const std::string port = "devices/usb3/3-2.4/3-2.4:1.0/ttyUSB77";
  link(port + "/subsystem", "/sys/bus/usb-serial");
  link(port + "/driver", "/sys/bus/usb-serial/drivers/ftdi_sio");
  link(port + "/tty/ttyUSB77/device", "../../../ttyUSB77");
  link("class/tty/ttyUSB77", "../../" + port + "/tty/ttyUSB77");
  EXPECT_EQ(identity("/dev/ttyUSB77"), (PortIdentity{.path = "/dev/ttyUSB77",
                                                     .vid = 0x0403,
                                                     .pid = 0x6001,
                                                     .serial = "A6008isP",
                                                     .manufacturer = "FTDI",
                                                     .product = "FT232R UART",
                                                     .interface = std::uint8_t{10},
                                                     .driver = "ftdi_sio",
                                                     .location = "3-2.4"}));
}

TEST_F(DeviceIdentity, OfAnInterfaceItself) {
  usb_device();
  const std::string interface = "devices/usb3/3-2.4/3-2.4:1.0";
  link(interface + "/subsystem", "/sys/bus/usb");
  link(interface + "/driver", "/sys/bus/usb/drivers/cdc_acm");
  link(interface + "/tty/ttyACM77/device", "../../../3-2.4:1.0");
  link("class/tty/ttyACM77", "../../" + interface + "/tty/ttyACM77");
  const auto found = identity("/dev/ttyACM77");
  ASSERT_TRUE(found);
  EXPECT_EQ(found->vid, 0x0403);
  EXPECT_EQ(found->driver, "cdc_acm");
}

TEST_F(DeviceIdentity, OfAPlainPortItsPathAlone) {
  link("devices/pnp0/00:05/subsystem", "/sys/bus/pnp");
  link("devices/pnp0/00:05/driver", "/sys/bus/pnp/drivers/serial");
  link("devices/pnp0/00:05/tty/ttyS77/device", "../../../00:05");
  link("class/tty/ttyS77", "../../devices/pnp0/00:05/tty/ttyS77");
  EXPECT_EQ(identity("/dev/ttyS77"), PortIdentity{.path = "/dev/ttyS77"});
}

TEST_F(DeviceIdentity, OfNoneThatTheSystemKnows) {
  fs::create_directories(sys / "class/tty");
  EXPECT_FALSE(identity("/dev/pts/0"));
  EXPECT_FALSE(identity("/dev/ttyUSB78"));
  EXPECT_FALSE(identity(""));
}

TEST_F(DeviceIdentity, WhatNoPathCanBeIsNone) {
  fs::create_directories(sys / "class/tty/ttyUSB77");
  EXPECT_FALSE(identity("/tmp/ttyUSB77"));
}

}  // namespace
}  // namespace porttape
