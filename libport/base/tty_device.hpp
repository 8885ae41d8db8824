#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace porttape {

// Whether a device of this number (st_rdev) is the terminal's side of a pseudo-terminal, by the kernel's
// list of numbers (Documentation/admin-guide/devices.txt: 136 to 143 char).
bool is_pty(std::uint64_t number);

// Which tty it is. A value.
//
// A device's number says so for all but pseudo-terminals: each devpts, as each container has one, counts its
// own from 0. Of these the file system is a part of the identity.
struct TtyDevice {
  std::uint64_t number = 0;                       // st_rdev
  std::optional<std::uint64_t> file_system = {};  // st_dev; nothing where it is no pty, or is not known

  // Whether both may be the same one. What is not known of one says nothing against it.
  [[nodiscard]] bool is(const TtyDevice& other) const {
    return number == other.number &&
           (!file_system || !other.file_system || *file_system == *other.file_system);
  }
};

// That of a path, links followed, or of an open file; nothing where that is no character device. One that is
// open only as a place (O_PATH) is none: whoever has it may have no right to the device.
std::optional<TtyDevice> tty_device_at(const std::string& path);
std::optional<TtyDevice> tty_device_of(int fd);

}  // namespace porttape
