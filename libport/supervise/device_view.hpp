#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "libport/base/port_identity.hpp"
#include "libport/base/result.hpp"

namespace porttape {

// A port as programs are to find it, and the pty that it is.
struct DevicePort {
  PortIdentity identity;
  std::string node;  // /dev/pts/3
};

// Gives this process, and all that it starts, a /dev of its own in which these ports are, by name, by
// /dev/serial/by-id and by-path, and as the kernel (/sys) and udev (/run/udev) would show them: pyserial,
// libserialport, libudev and udevadm find them as they find devices. What else is there stays there; a port
// takes the place of a device of its name. Nothing is made on the host, and all is gone with the last of the
// processes (PrivateMounts). A device that is plugged in later does not show.
//
// The node is the pty itself, under another name: once that is hung up, an open of the name fails (EIO), and
// a new pty, where there is one, is not under it.
//
// Single-threaded processes only. Errc::io: what forbids it; the process may have some of it then.
Result<void> enter_device_view(const std::vector<DevicePort>& ports);

// Whether that would work: tries it in a process of its own, and waits for that.
Result<void> can_enter_device_view(const std::vector<DevicePort>& ports);

// The variable of the environment by which libudev believes a /sys that is not the kernel's.
inline constexpr std::pair<std::string_view, std::string_view> kDeviceViewVariable = {
    "SYSTEMD_DEVICE_VERIFY_SYSFS", "0"};

}  // namespace porttape
