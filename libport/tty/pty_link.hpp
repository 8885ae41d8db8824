#pragma once

#include <string>
#include <utility>

#include "libport/base/result.hpp"
#include "libport/base/trusted_folder.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// A stable name for a pty: a symbolic link. The destructor removes it. The object never replaces or removes a
// file that somebody else has put in its place. publish() accepts an unused name, a dangling link, and a link
// that a killed program of ours left.
class PtyLink {
 public:
  // Errc::usage when the path is taken by a file or a link in use, its folder is missing, or another user's
  // link leads there.
  static Result<PtyLink> publish(const std::string& path, const std::string& target);

  PtyLink(PtyLink&& other) noexcept = default;
  PtyLink& operator=(PtyLink&& other) noexcept;
  PtyLink(const PtyLink&) = delete;
  PtyLink& operator=(const PtyLink&) = delete;
  ~PtyLink();

  // Points the link at another pty in one step, and makes it anew if somebody removed it. Errc::usage: the
  // path means somebody else's file, which is left there; the next retarget() tries again.
  Result<void> retarget(const std::string& target);
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  PtyLink(std::string path, TrustedName place, UniqueFd link)
      : path_(std::move(path)), place_(std::move(place)), link_(std::move(link)) {}
  void remove();

  std::string path_;
  TrustedName place_;
  // The link itself (O_PATH), so that no later file gets its inode number. Unset when moved from.
  UniqueFd link_;
};

}  // namespace porttape
