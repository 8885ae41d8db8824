#pragma once

#include <string>
#include <sys/types.h>
#include <utility>
#include <vector>

#include "libport/base/port_identity.hpp"

namespace porttape {

// What the kernel and udev would tell of a serial port, as files and links: pure.
struct DeviceTree {
  using Entry = std::pair<std::string, std::string>;  // path, content or target

  std::string folder;  // of the port's tty: /sys/class/tty/.porttape/usb1/1-1/1-1:1.0/ttyUSB0/tty/ttyUSB0
  std::vector<Entry> files;  // of /sys
  std::vector<Entry> links;
  std::vector<Entry> names;  // links in /dev: /dev/serial/by-id/…
  std::string udev_data;     // of the port
};

// `device` is the number that stat() shows for the port's node.
DeviceTree device_tree(const PortIdentity& identity, dev_t device);

}  // namespace porttape
