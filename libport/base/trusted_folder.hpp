#pragma once

#include <string>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// Opens a folder (O_PATH). The descriptor refers to that folder even if its path means another one later. The
// function follows links on the way only if root or this process's user owns them. Errc::usage: the folder
// does not exist, or another user's link leads to it.
Result<UniqueFd> open_trusted_folder(const std::string& path);

// A name in a folder that was opened so: what a path means, but for a link at its end. The way to each file
// and folder that a user names and this program makes.
struct TrustedName {
  UniqueFd folder;
  std::string name;
};
// Errors as open_trusted_folder(), for the path's folder.
Result<TrustedName> find_trusted_name(const std::string& path);

// Makes a folder for this user alone (0700) in `folder`, under a name that nothing has there: `prefix` and
// some letters. Returns the name; empty: errno has the reason.
std::string make_private_folder(int folder, const std::string& prefix);

}  // namespace porttape
