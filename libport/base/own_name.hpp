#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <sys/types.h>

namespace porttape {

// These functions replace and remove a file only if it is the one that this program put under that name.
// Other users may write to the same folder, so each function first checks which file has the name, and leaves
// a file that is not ours where it is.
//
// A name is relative to the descriptor `folder`; with AT_FDCWD it is a path. A link at its end is not
// followed.

// Identifies a file: its device, its inode number and the time of its birth (statx(2), STATX_BTIME). The
// number is unique while a descriptor of the file is open; O_PATH is enough. Once the file is gone the file
// system may give its number to another one. The time of birth then tells the two apart, if the file system
// stores it and a few milliseconds lie between them.
class FileIdentity {
 public:
  // std::nullopt where the file cannot be examined; errno has the reason.
  static std::optional<FileIdentity> of(int fd);  // also one that was opened with O_PATH
  static std::optional<FileIdentity> at(int folder, const std::string& name);

  bool operator==(const FileIdentity&) const = default;

 private:
  std::uint64_t device_ = 0;
  std::uint64_t inode_ = 0;
  std::int64_t made_s_ = 0;
  std::uint32_t made_ns_ = 0;
};

// Whether what belongs to that user is as good as ours: it is our user's, or root's.
bool is_own_or_root(uid_t user);

// Removes the name if it means that file, and returns whether it did.
bool remove_if_same(int folder, const std::string& name, const FileIdentity& file);
// The same for the file that `fd` has open; below 0 there is none.
bool remove_if_same(int folder, const std::string& name, int fd);

// Returns the text of a link, or an empty string where the name is no link or cannot be read. An empty name
// means the link that `folder` has open (O_PATH).
std::string link_text(int folder, const std::string& name);

// The following functions return 0 or an errno.

// Moves a file to an unused name. EEXIST: the name is in use.
int move_to_free_name(int folder, const std::string& from, const std::string& to);
// Exchanges what two names mean, in one step. EINVAL: the file system cannot.
int exchange_names(int folder, const std::string& one, const std::string& other);
// Moves a file to a name that is unused or means `old`, which it removes. There is no moment at which the
// name does not exist. EEXIST: the name means another file, which keeps it.
int move_over(int folder, const std::string& from, const std::string& to,
              const std::optional<FileIdentity>& old);

}  // namespace porttape
