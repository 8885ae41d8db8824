#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <sys/stat.h>

namespace porttape {

// Whether a device of this number (st_rdev) is the terminal's side of a pseudo-terminal, by the kernel's
// list of numbers (Documentation/admin-guide/devices.txt: 136 to 143 char).
bool is_pty(std::uint64_t number);

// The identity of a tty. A value.
//
// The number identifies every device but a pseudo-terminal. Each devpts numbers its own from 0, and a
// container has a devpts of its own, so the file system is a part of a pseudo-terminal's identity.
struct TtyDevice {
  std::uint64_t number = 0;                       // st_rdev
  std::optional<std::uint64_t> file_system = {};  // st_dev of a pty; nullopt: another device, or not known

  // Whether both may be the same device. Where one file system is not known, the numbers decide.
  [[nodiscard]] bool is(const TtyDevice& other) const {
    return number == other.number &&
           (!file_system || !other.file_system || *file_system == *other.file_system);
  }
};

// Returns the device at a path, whose links are followed; nullopt if there is no character device, or if it
// cannot be looked at.
std::optional<TtyDevice> tty_device_at(const std::string& path);

// Returns the device that `status` is of; nullopt if it is no character device.
std::optional<TtyDevice> tty_device_in(const struct stat& status);

// Returns the device that is open as `fd`; nullopt if that is not a character device. A descriptor that was
// opened with O_PATH does not count: the program that has it may have no right to the device.
std::optional<TtyDevice> tty_device_of(int fd);

}  // namespace porttape
