#pragma once

#include <optional>
#include <string>

#include "libport/base/port_identity.hpp"

namespace porttape {

// What the system knows of a serial device, given by any of its names; nothing where it knows no such device.
// What could not be given to a program again is left out. `sysfs`: where that is mounted.
std::optional<PortIdentity> identity_of(const std::string& device, const std::string& sysfs = "/sys");

}  // namespace porttape
