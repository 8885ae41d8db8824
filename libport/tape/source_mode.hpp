#pragma once

#include <span>
#include <string>
#include <sys/types.h>

#include "libport/base/result.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// What is made of stricter files is as strict: a file that this program makes keeps from its group and from
// others what any of the files that it is made of does, and what the file that it replaces does. These
// functions are that rule, for all that makes files of tapes.

// The permissions (S_IRWXG | S_IRWXO) that a file keeps from its group and from others, and that what is made
// of it is to keep from them too. 0: the file is not there, or is no regular file (the mode of a pipe says
// nothing).
mode_t kept_from_others(const std::string& file);
mode_t kept_from_others(int fd);
// The same for what any of the tape's files keeps from them.
mode_t kept_from_others(const TapePaths& tape);
mode_t kept_from_others(std::span<const TapePaths> tapes);

// Takes these permissions from a file of ours that is open. Returns 0 or the errno. On a file system without
// modes (vfat, a share) all files have one mode, and the function leaves it as it is.
int keep_from_others(int fd, mode_t kept);
// The same for the files of a tape that nobody else can reach yet. Errc::io.
Result<void> keep_from_others(const TapePaths& tape, mode_t kept);

// While it lives, what this process makes keeps those permissions from the group and from others. It sets the
// umask, so there is no moment at which a new file is open to more people; threads and children have that
// umask, too.
class ModeOfSources {
 public:
  explicit ModeOfSources(mode_t kept);
  explicit ModeOfSources(std::span<const TapePaths> tapes) : ModeOfSources(kept_from_others(tapes)) {}
  explicit ModeOfSources(const TapePaths& tape) : ModeOfSources(kept_from_others(tape)) {}
  explicit ModeOfSources(const std::string& file) : ModeOfSources(kept_from_others(file)) {}
  ModeOfSources(const ModeOfSources&) = delete;
  ModeOfSources& operator=(const ModeOfSources&) = delete;
  ~ModeOfSources();

 private:
  mode_t before_;
};

}  // namespace porttape
