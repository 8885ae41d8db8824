#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace porttape {

// Names in folders, and whether they still mean what this program put there. A folder that others write to
// may hold anything at any time: what is replaced or removed is looked at first, and what turns out to be
// somebody else's is left under its name.
//
// A name is a path, or, with the descriptor of a folder, relative to that. No link is followed at its end.

// Which file it is. While a descriptor of it is open (O_PATH is enough) no other file has its number; of one
// that is not, a file that has its number later is known by when it was made, where the file system tells that
// (statx(2), STATX_BTIME, in steps of some milliseconds).
class FileIdentity {
 public:
  // Nothing: it cannot be looked at, and errno says why.
  static std::optional<FileIdentity> of(int fd);  // also one that was opened with O_PATH
  static std::optional<FileIdentity> at(int folder, const std::string& name);

  bool operator==(const FileIdentity&) const = default;

 private:
  std::uint64_t device_ = 0;
  std::uint64_t inode_ = 0;
  std::int64_t made_s_ = 0;
  std::uint32_t made_ns_ = 0;
};

// Takes the name away if it means that file. Whether it did.
bool remove_if_same(int folder, const std::string& name, const FileIdentity& file);

// These give 0 or the errno.

// Moves a file to a name that nothing has; EEXIST: something has it.
int move_to_free_name(int folder, const std::string& from, const std::string& to);
// Exchanges what two names mean, in one step. EINVAL: the file system cannot.
int exchange_names(int folder, const std::string& one, const std::string& other);
// Moves a file to a name that means `old`, or nothing, and removes that. The name is never missing. EEXIST:
// something else has it, and keeps it.
int move_over(int folder, const std::string& from, const std::string& to,
              const std::optional<FileIdentity>& old);

}  // namespace porttape
