#pragma once

#include <cstdint>
#include <string>

#include "libport/base/result.hpp"

namespace porttape {

// Makes the mounts of this process its own: what it mounts from then on nobody else sees but the processes
// that it starts, and it is gone with the last of them. What the system mounts and unmounts still shows. With
// CAP_SYS_ADMIN in a mount namespace; else in a user namespace too, in which the user keeps its number, files
// of others show as nobody's, and setuid programs run without their rights. Single-threaded processes only.
//
// enter(), mount, then drop_gained().
class PrivateMounts {
 public:
  // Errc::io: what forbids it and what to do.
  static Result<PrivateMounts> enter();

  // The error of a mount() in there, which may be forbidden for another reason than others.
  [[nodiscard]] Error refused(const std::string& what, int error_number) const;
  // The capabilities that the user namespace gave.
  Result<void> drop_gained() const;

 private:
  bool in_user_namespace_ = false;
  std::uint64_t before_ = 0;  // capabilities
};

}  // namespace porttape
