#pragma once

#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <string>

#include "libport/base/printable.hpp"
#include "libport/base/result.hpp"
#include "libport/tape/leftover.hpp"

namespace porttape {

// A folder of our own for a driver's port, or for a tape on its way to another form.
class PrivateFolder {
 public:
  PrivateFolder() = default;
  PrivateFolder(const PrivateFolder&) = delete;
  PrivateFolder& operator=(const PrivateFolder&) = delete;

  // Its path. Errc::io. Once.
  Result<std::string> make() {
    const std::string prefix = (std::filesystem::temp_directory_path() / "porttape-").string();
    folder_ = Leftover::make_folder(AT_FDCWD, {}, prefix);
    if (folder_.path().empty())
      return make_error(Errc::io, fmt::format("folder {}…: {}", in_quotes(prefix), errno_text(errno)));
    return folder_.path();
  }

 private:
  Leftover folder_;
};

}  // namespace porttape
