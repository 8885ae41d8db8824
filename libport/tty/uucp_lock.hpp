#pragma once

#include <optional>
#include <string>
#include <sys/types.h>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// Lock files as UUCP had them, by which programs that know neither flock nor TIOCEXCL tell each other that
// they use a serial device: `LCK..ttyUSB0` in /var/lock. One holds the number of its process, as text or as a
// binary int. A process that is dead has no lock.
inline constexpr const char* kUucpLockFolder = "/var/lock";
inline constexpr const char* kDeviceFolder = "/dev";

// Who has locked a device.
struct UucpHolder {
  std::string file;
  pid_t pid = 0;
  std::string program = {};  // empty: unknown
};

// The process, other than this one, that has locked the device by the name it is given here or by the name of
// what that resolves to (/dev/serial/by-id/X: LCK..X and LCK..ttyUSB0). A file that holds no number is
// nobody's.
// The name given counts only below `devices`: elsewhere it says little (/tmp/a/port and /tmp/b/port are two).
std::optional<UucpHolder> uucp_holder(const std::string& folder, const std::string& device,
                                      const std::string& devices = kDeviceFolder);

// For messages: who it is, and what is to be done.
std::string to_text(const UucpHolder& holder);

// Both locks of a device, held by this process as long as this lives.
class UucpLock {
 public:
  // Takes the place of locks of dead processes. Errc::device_missing: a living one has it; Errc::io: it
  // cannot be made (no such folder, no rights to it, a file that holds no number).
  static Result<UucpLock> take(const std::string& folder, const std::string& device,
                               const std::string& devices = kDeviceFolder);

  UucpLock(UucpLock&& other) noexcept = default;
  UucpLock& operator=(UucpLock&&) = delete;
  UucpLock(const UucpLock&) = delete;
  UucpLock& operator=(const UucpLock&) = delete;
  ~UucpLock();

 private:
  UucpLock() = default;

  std::vector<std::string> files_;  // one file under these names
  UniqueFd lock_;                   // that file
};

}  // namespace porttape
