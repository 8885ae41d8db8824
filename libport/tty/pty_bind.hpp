#pragma once

#include <string>
#include <utility>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// A stable name for a pty where a symbolic link leads nowhere, as in a container that has another /dev/pts: a
// bind mount of the pty on a file. The destructor unmounts it, wherever its folder has been moved to, and
// removes the file if this object made it and nobody has replaced it. It leaves the mount if somebody else
// has mounted something on top of it. publish() accepts an unused name, an empty file, and a mount that a
// killed program left (its pty is dead). All operations use descriptors, so that a name that somebody changes
// in between cannot lead to another place. The class needs CAP_SYS_ADMIN.
class PtyBind {
 public:
  // Errc::usage when the path is taken, its folder is missing or reached by another user's link, or nothing
  // may be mounted.
  static Result<PtyBind> publish(const std::string& path, const std::string& pty);

  PtyBind(PtyBind&& other) noexcept;
  PtyBind& operator=(PtyBind&&) = delete;
  PtyBind(const PtyBind&) = delete;
  PtyBind& operator=(const PtyBind&) = delete;
  ~PtyBind();

  // Mounts another pty in its place: in one step from Linux 6.5 on, before with a moment between in which the
  // path is an empty file.
  Result<void> retarget(const std::string& pty);
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  PtyBind(std::string path, UniqueFd folder, std::string name)
      : path_(std::move(path)), folder_(std::move(folder)), name_(std::move(name)) {}
  Result<void> take_place();
  Result<void> mount(const std::string& pty);
  Result<void> mount_by_names(const std::string& pty, int file);
  Result<void> unmount();
  void remove();

  std::string path_;   // as it was given: for texts
  UniqueFd folder_;    // none: moved from
  std::string name_;   // in it
  UniqueFd file_;      // under the mount, itself
  bool made_ = false;  // that file
  UniqueFd mount_;     // of the pty, while it is mounted
};

}  // namespace porttape
