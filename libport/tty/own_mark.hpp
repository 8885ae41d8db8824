#pragma once

#include <ctime>
#include <string>
#include <sys/stat.h>

namespace porttape {

// A mark on links and files that we make under a name of the user's, so that one that a killed program left
// is known again: the nanoseconds of the modification time, which other programs hardly ever have just so.

// Marks a name in a folder (AT_FDCWD: a path; a link itself, not what it points to) with a time up to a
// millisecond behind that one.
void mark_as_own(int folder, const std::string& name, timespec time);
[[nodiscard]] bool is_marked_as_own(const struct stat& status);

}  // namespace porttape
