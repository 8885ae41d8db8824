#pragma once

#include <span>
#include <string>
#include <sys/types.h>

#include "libport/base/result.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// The rule for every file that this program makes of tapes and other files: a permission of the group or of
// others that one of the sources lacks, or the file that is replaced, the new file lacks too.

// Returns the permissions (S_IRWXG | S_IRWXO) that the file does not give to its group and to others; 0 if
// there is no such file, or it is not a regular one (the mode of a pipe means nothing).
mode_t kept_from_others(const std::string& file);
mode_t kept_from_others(int fd);
// The same for all files of a tape, or of several: what any of them does not give.
mode_t kept_from_others(const TapePaths& tape);
mode_t kept_from_others(std::span<const TapePaths> tapes);

// Removes these permissions from an open file that this process has made. Returns 0 or an errno. A file
// system without modes (vfat, a share) has one mode for all files; the function leaves that alone and
// returns 0.
int keep_from_others(int fd, mode_t kept);
// The same for a tape's files, which are in a folder that other users cannot open. Errc::io.
Result<void> keep_from_others(const TapePaths& tape, mode_t kept);

// While this object exists, new files of this process lack those permissions from the start, since the object
// sets the umask. All threads have that umask, and so do child processes.
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
