#pragma once

#include <string>
#include <utility>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// A stable name for a pty: a symbolic link that this object made and takes away again. What somebody else has
// put in its place since is never replaced or removed. It takes the place of nothing, of a dangling link, or
// of one of its own that a killed program left.
class PtyLink {
 public:
  // Errc::usage when the path is taken by a file or a link in use, or its folder is missing.
  static Result<PtyLink> publish(const std::string& path, const std::string& target);

  PtyLink(PtyLink&& other) noexcept = default;
  PtyLink& operator=(PtyLink&& other) noexcept;
  PtyLink(const PtyLink&) = delete;
  PtyLink& operator=(const PtyLink&) = delete;
  ~PtyLink();

  // Points it at another pty, in one step: the path is never missing. Makes it again where somebody removed
  // it. Errc::usage: somebody else's file is there by now; it stays, and the next retarget() tries again.
  Result<void> retarget(const std::string& target);
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  PtyLink(std::string path, UniqueFd link) : path_(std::move(path)), link_(std::move(link)) {}
  void remove();

  std::string path_;
  UniqueFd link_;  // itself (O_PATH): while it is open no other one is taken for it; none: moved from
};

}  // namespace porttape
