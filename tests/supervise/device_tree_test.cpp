#include "libport/supervise/device_tree.hpp"

#include <algorithm>
#include <string>
#include <sys/sysmacros.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace porttape {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

const PortIdentity kFtdi{.path = "/dev/ttyUSB0",
                         .vid = 0x0403,
                         .pid = 0x6001,
                         .serial = "PT0001",
                         .manufacturer = "FTDI",
                         .product = "FT232R USB UART"};

std::string of(const std::vector<DeviceTree::Entry>& entries, const std::string& path) {
  const auto found = std::ranges::find(entries, path, &DeviceTree::Entry::first);
  return found == entries.end() ? "none" : found->second;
}

TEST(DeviceTree, AUsbSerialPortIsAChildOfTheInterface) {
  const DeviceTree tree = device_tree(kFtdi, makedev(136, 3));
  const std::string device = "/sys/class/tty/.porttape/usb1/1-1";
  EXPECT_EQ(tree.folder, device + "/1-1:1.0/ttyUSB0/tty/ttyUSB0");
  EXPECT_EQ(of(tree.files, device + "/idVendor"), "0403\n");
  EXPECT_EQ(of(tree.files, device + "/serial"), "PT0001\n");
  EXPECT_EQ(of(tree.files, tree.folder + "/dev"), "136:3\n");
  EXPECT_EQ(of(tree.files, tree.folder + "/uevent"), "MAJOR=136\nMINOR=3\nDEVNAME=ttyUSB0\n");
  EXPECT_EQ(of(tree.links, tree.folder + "/device"), "../../../ttyUSB0");
  EXPECT_EQ(of(tree.links, "/sys/class/tty/ttyUSB0"), ".porttape/usb1/1-1/1-1:1.0/ttyUSB0/tty/ttyUSB0");
  EXPECT_EQ(of(tree.links, "/sys/dev/char/136:3"),
            "../../class/tty/.porttape/usb1/1-1/1-1:1.0/ttyUSB0/tty/ttyUSB0");
  EXPECT_EQ(of(tree.links, "/sys/bus/usb-serial/devices/ttyUSB0"),
            "../../../class/tty/.porttape/usb1/1-1/1-1:1.0/ttyUSB0");
  EXPECT_EQ(of(tree.files, device + "/bNumInterfaces"), " 1\n");
  EXPECT_THAT(tree.udev_data, HasSubstr("E:ID_USB_SERIAL_SHORT=PT0001\n"));
  EXPECT_EQ(of(tree.names, "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_PT0001-if00-port0"), "../../ttyUSB0");
  EXPECT_THAT(tree.udev_data, HasSubstr("S:serial/by-id/usb-FTDI_FT232R_USB_UART_PT0001-if00-port0\n"));
  EXPECT_THAT(tree.udev_data, HasSubstr("E:ID_MODEL_ENC=FT232R\\x20USB\\x20UART\n"));
  EXPECT_THAT(tree.udev_data, HasSubstr("E:ID_SERIAL_SHORT=PT0001\n"));
}

TEST(DeviceTree, AnAcmPortIsTheInterfacesOwn) {
  PortIdentity port{.path = "/dev/ttyACM3", .vid = 0x2341, .pid = 0x43};
  port.location = "2-1.4";
  const DeviceTree tree = device_tree(port, makedev(136, 3));
  EXPECT_EQ(tree.folder, "/sys/class/tty/.porttape/usb2/2-1.4/2-1.4:1.0/tty/ttyACM3");
  EXPECT_EQ(of(tree.links, tree.folder + "/device"), "../../../2-1.4:1.0");
  EXPECT_EQ(of(tree.names, "/dev/serial/by-id/usb-2341_0043-if00"), "../../ttyACM3");
  EXPECT_EQ(of(tree.names, "/dev/serial/by-path/platform-porttape-usb-0:1.4:1.0"), "../../ttyACM3");
  EXPECT_EQ(of(tree.files, "/sys/class/tty/.porttape/usb2/2-1.4/bNumInterfaces"), " 2\n");
  EXPECT_EQ(of(tree.links, "/sys/bus/usb-serial/devices/ttyACM3"), "none");
  EXPECT_THAT(tree.udev_data, Not(HasSubstr("ID_SERIAL_SHORT")));
  EXPECT_THAT(tree.udev_data, HasSubstr("E:ID_VENDOR_ENC=2341\n"));
}

TEST(DeviceTree, APlainPortHasNothingOfUsb) {
  const DeviceTree tree = device_tree({.path = "/dev/ttyS0"}, makedev(136, 3));
  EXPECT_EQ(of(tree.links, "/sys/class/tty/ttyS0"), ".porttape/pnp0/00:ttyS0/tty/ttyS0");
  EXPECT_THAT(tree.names, IsEmpty());
  EXPECT_THAT(tree.udev_data, Not(HasSubstr("ID_BUS")));
}

TEST(DeviceTree, APathInAFolderIsNamedAsTheKernelNamesIt) {
  PortIdentity port = kFtdi;
  port.path = "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_PT0001-if00-port0";
  const DeviceTree tree = device_tree(port, makedev(136, 3));
  EXPECT_THAT(tree.folder, testing::EndsWith("/serial!by-id!usb-FTDI_FT232R_USB_UART_PT0001-if00-port0"));
  // Its own name is no link to itself.
  EXPECT_EQ(of(tree.names, port.path), "none");
}

}  // namespace
}  // namespace porttape
