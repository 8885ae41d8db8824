#pragma once

#include <string>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

// A folder by its descriptor (O_PATH), which goes on meaning it whatever happens to its path. On the way
// there only links of root and of our own user are followed: nobody else leads us anywhere. Errc::usage.
Result<UniqueFd> open_trusted_folder(const std::string& path);

}  // namespace porttape
