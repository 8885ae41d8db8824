#include "libport/supervise/port_devices.hpp"

#include <string>
#include <string_view>
#include <sys/sysmacros.h>
#include <utility>

#include <gtest/gtest.h>

#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

// As a kernel of Debian 12 lists them.
constexpr std::string_view kDrivers =
    "/dev/tty             /dev/tty        5       0 system:/dev/tty\n"
    "/dev/ptmx            /dev/ptmx       5       2 system\n"
    "usbserial            /dev/ttyUSB   188 0-511 serial\n"
    "acm                  /dev/ttyACM   166 0-255 serial\n"
    "serial               /dev/ttyS       4 64-67 serial\n"
    "one                  /dev/ttyX     204 5 serial\n"
    "broken\n"
    "pty_slave            /dev/pts      136 0-1048575 pty:slave\n"
    "unknown              /dev/tty        4 1-63 console\n";

TEST(PortDevices, ASerialTtyIsKnownByTheKernelsListOfDrivers) {
  const test::TempDir dir;
  const std::string drivers = dir / "drivers";
  test::write_file(drivers, test::bytes_of(std::string(kDrivers)));
  for (const auto& [kind, number] :
       {std::pair(188U, 0U), {188U, 511U}, {166U, 255U}, {4U, 64U}, {4U, 67U}, {204U, 5U}})
    EXPECT_TRUE(is_serial(makedev(kind, number), drivers)) << kind << ':' << number;
  for (const auto& [kind, number] : {std::pair(188U, 512U),
                                     {4U, 63U},
                                     {4U, 68U},
                                     {204U, 4U},
                                     {204U, 6U},
                                     {5U, 0U},
                                     {136U, 3U},
                                     {10U, 200U}})
    EXPECT_FALSE(is_serial(makedev(kind, number), drivers)) << kind << ':' << number;
}

TEST(PortDevices, WithoutTheListNothingIsKnownToBeSerial) {
  EXPECT_FALSE(is_serial(makedev(188, 0), "/proc/self/no-such-list"));
}

TEST(PortDevices, WhatProgramsTalkToPeopleByIsNoPort) {
  const PortDevices ports;
  for (const auto& [kind, number] : {std::pair(1U, 3U), {5U, 0U}, {5U, 1U}, {4U, 0U}, {4U, 63U}})
    EXPECT_FALSE(ports.can_be(makedev(kind, number))) << kind << ':' << number;
  for (const auto& [kind, number] : {std::pair(4U, 64U), {188U, 0U}, {166U, 0U}})
    EXPECT_TRUE(ports.can_be(makedev(kind, number))) << kind << ':' << number;
}

// TIOCGDEV and proc_pid_stat(5): major in bits 8 to 19, minor in bits 0 to 7 and 20 to 31.
TEST(PortDevices, AKernelsWordIsADevicesNumber) {
  EXPECT_EQ(device_number(0x8803U), makedev(136, 3));
  EXPECT_EQ(device_number(0x12388ff0U), makedev(0x88f, 0x123f0));
}

}  // namespace
}  // namespace porttape
