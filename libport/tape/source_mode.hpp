#pragma once

#include <string>
#include <sys/types.h>

#include "libport/tape/tape_name.hpp"

namespace porttape {

// The permissions (S_IRWXG | S_IRWXO) that a file keeps from its group and from others, and that what is made
// of it keeps from them too. 0: the file is not there, or is no regular file (the mode of a pipe says
// nothing).
mode_t kept_from_others(const std::string& file);
mode_t kept_from_others(int fd);
// The same for what any of the tape's files keeps from them.
mode_t kept_from_others(const TapePaths& tape);

}  // namespace porttape
