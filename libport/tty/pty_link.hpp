#pragma once

#include <string>

#include "libport/base/result.hpp"

namespace porttape {

// A stable name for a pty: a symbolic link that this object made and takes away again, unless somebody
// replaced it meanwhile. Replaces nothing but a dangling link or one of its own that a killed program left.
class PtyLink {
 public:
  // Errc::usage when the path is taken by a file or a link in use, or its folder is missing.
  static Result<PtyLink> publish(const std::string& path, const std::string& target);

  PtyLink(PtyLink&& other) noexcept;
  PtyLink& operator=(PtyLink&& other) noexcept;
  PtyLink(const PtyLink&) = delete;
  PtyLink& operator=(const PtyLink&) = delete;
  ~PtyLink();

  // Points it at another pty, in one step: the path is never missing.
  Result<void> retarget(const std::string& target);
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  PtyLink(std::string path, std::string target);
  void remove();

  std::string path_;  // empty: moved from
  std::string target_;
};

}  // namespace porttape
