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

// All of it, in the order in which it is made.
std::string text_of(const DeviceTree& tree) {
  std::string text;
  for (const auto& [path, content] : tree.files) text.append(path).append(" = ").append(content);
  for (const auto* const links : {&tree.links, &tree.names}) {
    for (const auto& [path, target] : *links) text.append(path).append(" -> ").append(target).append("\n");
  }
  return text + tree.udev_data;
}

TEST(DeviceTree, AllThatIsToldOfAUsbSerialPort) {
  EXPECT_EQ(text_of(device_tree(kFtdi, makedev(136, 3))), R"(/sys/class/tty/.porttape/usb1/1-1/idVendor = 0403
/sys/class/tty/.porttape/usb1/1-1/idProduct = 6001
/sys/class/tty/.porttape/usb1/1-1/serial = PT0001
/sys/class/tty/.porttape/usb1/1-1/manufacturer = FTDI
/sys/class/tty/.porttape/usb1/1-1/product = FT232R USB UART
/sys/class/tty/.porttape/usb1/1-1/bNumInterfaces =  1
/sys/class/tty/.porttape/usb1/1-1/bDeviceClass = 00
/sys/class/tty/.porttape/usb1/1-1/bcdDevice = 0100
/sys/class/tty/.porttape/usb1/1-1/busnum = 1
/sys/class/tty/.porttape/usb1/1-1/devnum = 2
/sys/class/tty/.porttape/usb1/1-1/devpath = 1
/sys/class/tty/.porttape/usb1/1-1/speed = 12
/sys/class/tty/.porttape/usb1/1-1/version =  2.00
/sys/class/tty/.porttape/usb1/1-1/uevent = DEVTYPE=usb_device
DRIVER=usb
PRODUCT=403/6001/100
TYPE=0/0/0
BUSNUM=001
DEVNUM=002
/sys/class/tty/.porttape/usb1/1-1/1-1:1.0/bInterfaceNumber = 00
/sys/class/tty/.porttape/usb1/1-1/1-1:1.0/bInterfaceClass = ff
/sys/class/tty/.porttape/usb1/1-1/1-1:1.0/uevent = DEVTYPE=usb_interface
DRIVER=ftdi_sio
PRODUCT=403/6001/100
TYPE=0/0/0
INTERFACE=255/0/0
/sys/class/tty/.porttape/usb1/1-1/1-1:1.0/ttyUSB0/port_number = 0
/sys/class/tty/.porttape/usb1/1-1/1-1:1.0/ttyUSB0/latency_timer = 16
/sys/class/tty/.porttape/usb1/1-1/1-1:1.0/ttyUSB0/uevent = DRIVER=ftdi_sio
/sys/class/tty/.porttape/usb1/1-1/1-1:1.0/ttyUSB0/tty/ttyUSB0/dev = 136:3
/sys/class/tty/.porttape/usb1/1-1/1-1:1.0/ttyUSB0/tty/ttyUSB0/uevent = MAJOR=136
MINOR=3
DEVNAME=ttyUSB0
/sys/class/tty/.porttape/usb1/1-1/subsystem -> /sys/bus/usb
/sys/class/tty/.porttape/usb1/1-1/driver -> /sys/bus/usb/drivers/usb
/sys/class/tty/.porttape/usb1/1-1/1-1:1.0/subsystem -> /sys/bus/usb
/sys/class/tty/.porttape/usb1/1-1/1-1:1.0/driver -> /sys/bus/usb/drivers/ftdi_sio
/sys/class/tty/.porttape/usb1/1-1/1-1:1.0/ttyUSB0/subsystem -> /sys/bus/usb-serial
/sys/class/tty/.porttape/usb1/1-1/1-1:1.0/ttyUSB0/driver -> /sys/bus/usb-serial/drivers/ftdi_sio
/sys/bus/usb-serial/devices/ttyUSB0 -> ../../../class/tty/.porttape/usb1/1-1/1-1:1.0/ttyUSB0
/sys/class/tty/.porttape/usb1/1-1/1-1:1.0/ttyUSB0/tty/ttyUSB0/device -> ../../../ttyUSB0
/sys/class/tty/.porttape/usb1/1-1/1-1:1.0/ttyUSB0/tty/ttyUSB0/subsystem -> /sys/class/tty
/sys/class/tty/ttyUSB0 -> .porttape/usb1/1-1/1-1:1.0/ttyUSB0/tty/ttyUSB0
/sys/dev/char/136:3 -> ../../class/tty/.porttape/usb1/1-1/1-1:1.0/ttyUSB0/tty/ttyUSB0
/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_PT0001-if00-port0 -> ../../ttyUSB0
/dev/serial/by-path/platform-porttape-usb-0:1:1.0-port0 -> ../../ttyUSB0
S:serial/by-id/usb-FTDI_FT232R_USB_UART_PT0001-if00-port0
S:serial/by-path/platform-porttape-usb-0:1:1.0-port0
I:1
E:ID_BUS=usb
E:ID_VENDOR=FTDI
E:ID_VENDOR_ENC=FTDI
E:ID_VENDOR_ID=0403
E:ID_MODEL=FT232R_USB_UART
E:ID_MODEL_ENC=FT232R\x20USB\x20UART
E:ID_MODEL_ID=6001
E:ID_REVISION=0100
E:ID_SERIAL=FTDI_FT232R_USB_UART_PT0001
E:ID_SERIAL_SHORT=PT0001
E:ID_TYPE=generic
E:ID_USB_VENDOR=FTDI
E:ID_USB_VENDOR_ENC=FTDI
E:ID_USB_VENDOR_ID=0403
E:ID_USB_MODEL=FT232R_USB_UART
E:ID_USB_MODEL_ENC=FT232R\x20USB\x20UART
E:ID_USB_MODEL_ID=6001
E:ID_USB_REVISION=0100
E:ID_USB_SERIAL=FTDI_FT232R_USB_UART_PT0001
E:ID_USB_SERIAL_SHORT=PT0001
E:ID_USB_TYPE=generic
E:ID_USB_INTERFACE_NUM=00
E:ID_USB_INTERFACES=:ffffff:
E:ID_USB_DRIVER=ftdi_sio
E:ID_PATH=platform-porttape-usb-0:1:1.0
G:systemd
Q:systemd
V:1
)");
}

TEST(DeviceTree, AllThatIsToldOfAnAcmPort) {
  PortIdentity port{.path = "/dev/ttyACM3", .vid = 0x2341, .pid = 0x43};
  port.location = "2-1.4";
  EXPECT_EQ(text_of(device_tree(port, makedev(136, 3))),
            R"(/sys/class/tty/.porttape/usb2/2-1.4/idVendor = 2341
/sys/class/tty/.porttape/usb2/2-1.4/idProduct = 0043
/sys/class/tty/.porttape/usb2/2-1.4/bNumInterfaces =  2
/sys/class/tty/.porttape/usb2/2-1.4/bDeviceClass = 00
/sys/class/tty/.porttape/usb2/2-1.4/bcdDevice = 0100
/sys/class/tty/.porttape/usb2/2-1.4/busnum = 2
/sys/class/tty/.porttape/usb2/2-1.4/devnum = 2
/sys/class/tty/.porttape/usb2/2-1.4/devpath = 1.4
/sys/class/tty/.porttape/usb2/2-1.4/speed = 12
/sys/class/tty/.porttape/usb2/2-1.4/version =  2.00
/sys/class/tty/.porttape/usb2/2-1.4/uevent = DEVTYPE=usb_device
DRIVER=usb
PRODUCT=2341/43/100
TYPE=0/0/0
BUSNUM=002
DEVNUM=002
/sys/class/tty/.porttape/usb2/2-1.4/2-1.4:1.0/bInterfaceNumber = 00
/sys/class/tty/.porttape/usb2/2-1.4/2-1.4:1.0/bInterfaceClass = 02
/sys/class/tty/.porttape/usb2/2-1.4/2-1.4:1.0/uevent = DEVTYPE=usb_interface
DRIVER=cdc_acm
PRODUCT=2341/43/100
TYPE=0/0/0
INTERFACE=2/0/0
/sys/class/tty/.porttape/usb2/2-1.4/2-1.4:1.0/tty/ttyACM3/dev = 136:3
/sys/class/tty/.porttape/usb2/2-1.4/2-1.4:1.0/tty/ttyACM3/uevent = MAJOR=136
MINOR=3
DEVNAME=ttyACM3
/sys/class/tty/.porttape/usb2/2-1.4/subsystem -> /sys/bus/usb
/sys/class/tty/.porttape/usb2/2-1.4/driver -> /sys/bus/usb/drivers/usb
/sys/class/tty/.porttape/usb2/2-1.4/2-1.4:1.0/subsystem -> /sys/bus/usb
/sys/class/tty/.porttape/usb2/2-1.4/2-1.4:1.0/driver -> /sys/bus/usb/drivers/cdc_acm
/sys/class/tty/.porttape/usb2/2-1.4/2-1.4:1.0/tty/ttyACM3/device -> ../../../2-1.4:1.0
/sys/class/tty/.porttape/usb2/2-1.4/2-1.4:1.0/tty/ttyACM3/subsystem -> /sys/class/tty
/sys/class/tty/ttyACM3 -> .porttape/usb2/2-1.4/2-1.4:1.0/tty/ttyACM3
/sys/dev/char/136:3 -> ../../class/tty/.porttape/usb2/2-1.4/2-1.4:1.0/tty/ttyACM3
/dev/serial/by-id/usb-2341_0043-if00 -> ../../ttyACM3
/dev/serial/by-path/platform-porttape-usb-0:1.4:1.0 -> ../../ttyACM3
S:serial/by-id/usb-2341_0043-if00
S:serial/by-path/platform-porttape-usb-0:1.4:1.0
I:1
E:ID_BUS=usb
E:ID_VENDOR=2341
E:ID_VENDOR_ENC=2341
E:ID_VENDOR_ID=2341
E:ID_MODEL=0043
E:ID_MODEL_ENC=0043
E:ID_MODEL_ID=0043
E:ID_REVISION=0100
E:ID_SERIAL=2341_0043
E:ID_TYPE=generic
E:ID_USB_VENDOR=2341
E:ID_USB_VENDOR_ENC=2341
E:ID_USB_VENDOR_ID=2341
E:ID_USB_MODEL=0043
E:ID_USB_MODEL_ENC=0043
E:ID_USB_MODEL_ID=0043
E:ID_USB_REVISION=0100
E:ID_USB_SERIAL=2341_0043
E:ID_USB_TYPE=generic
E:ID_USB_INTERFACE_NUM=00
E:ID_USB_INTERFACES=:020201:0a0000:
E:ID_USB_DRIVER=cdc_acm
E:ID_PATH=platform-porttape-usb-0:1.4:1.0
G:systemd
Q:systemd
V:1
)");
}

TEST(DeviceTree, AllThatIsToldOfAPlainPort) {
  EXPECT_EQ(text_of(device_tree({.path = "/dev/ttyS0"}, makedev(136, 3))),
            R"(/sys/class/tty/.porttape/pnp0/00:ttyS0/id = PNP0501
/sys/class/tty/.porttape/pnp0/00:ttyS0/uevent = DRIVER=serial
/sys/class/tty/.porttape/pnp0/00:ttyS0/tty/ttyS0/dev = 136:3
/sys/class/tty/.porttape/pnp0/00:ttyS0/tty/ttyS0/uevent = MAJOR=136
MINOR=3
DEVNAME=ttyS0
/sys/class/tty/.porttape/pnp0/00:ttyS0/subsystem -> /sys/bus/pnp
/sys/class/tty/.porttape/pnp0/00:ttyS0/driver -> /sys/bus/pnp/drivers/serial
/sys/class/tty/.porttape/pnp0/00:ttyS0/tty/ttyS0/device -> ../../../00:ttyS0
/sys/class/tty/.porttape/pnp0/00:ttyS0/tty/ttyS0/subsystem -> /sys/class/tty
/sys/class/tty/ttyS0 -> .porttape/pnp0/00:ttyS0/tty/ttyS0
/sys/dev/char/136:3 -> ../../class/tty/.porttape/pnp0/00:ttyS0/tty/ttyS0
I:1
G:systemd
Q:systemd
V:1
)");
}

TEST(DeviceTree, OnlyTextsThatUdevTakesForNamesStandAsTheyAre) {
  PortIdentity port = kFtdi;
  port.manufacturer = "A\xc3\xa4/B";
  EXPECT_THAT(device_tree(port, makedev(136, 3)).udev_data, HasSubstr("E:ID_VENDOR_ENC=A\xc3\xa4\\x2fB\n"));
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
