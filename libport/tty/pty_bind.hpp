#pragma once

#include <string>
#include <sys/types.h>

#include "libport/base/result.hpp"

namespace porttape {

// A stable name for a pty where a symbolic link leads nowhere, as in a container that has another /dev/pts: a
// bind mount of the pty on a file. It is taken away again, and the file too where this object made it, unless
// somebody replaced it meanwhile. Takes no place but that of nothing, of an empty file, and of a mount that a
// killed program left (its pty is dead). Needs CAP_SYS_ADMIN.
class PtyBind {
 public:
  // Errc::usage when the path is taken, its folder is missing, or nothing may be mounted.
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
  explicit PtyBind(std::string path) : path_(std::move(path)) {}
  Result<void> take_place();
  Result<void> mount(const std::string& pty);
  [[nodiscard]] bool is_there() const;
  void unmount();
  void remove();

  std::string path_;   // empty: moved from
  bool made_ = false;  // the file under the mount
  dev_t device_ = 0;   // of the mounted pty, by which it is known again
  ino_t inode_ = 0;
};

}  // namespace porttape
