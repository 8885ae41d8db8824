#pragma once

#include <cerrno>
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
    const std::string pattern = (std::filesystem::temp_directory_path() / "porttape-XXXXXX").string();
    folder_ = Leftover::make_folder(pattern);
    if (folder_.path().empty())
      return make_error(Errc::io, fmt::format("folder {}: {}", in_quotes(pattern), errno_text(errno)));
    return folder_.path();
  }

 private:
  Leftover folder_;
};

}  // namespace porttape
