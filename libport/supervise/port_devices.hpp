#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace porttape {

// Which ttys may be a driver's port: all but what programs talk to people by, which are the controlling
// terminal of this process, what its stdin, stdout and stderr are, and consoles. A value.
class PortDevices {
 public:
  PortDevices();

  // By its device number (st_rdev).
  [[nodiscard]] bool can_be(std::uint64_t device) const;

 private:
  std::vector<std::uint64_t> terminals_;
};

// Whether it is of a tty driver of the kind `serial`, by the kernel's list of these (proc_tty(5): a name, a
// path, a major number, one or a range of minor numbers, a kind in each line).
bool is_serial(std::uint64_t device, const std::string& drivers = "/proc/tty/drivers");

// By the kernel's word for a device's number in 32 bits (TIOCGDEV, proc_pid_stat(5)).
std::uint64_t device_number(std::uint32_t word);

}  // namespace porttape
