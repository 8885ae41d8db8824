#pragma once

#include <cerrno>
#include <filesystem>
#include <fmt/format.h>
#include <stdlib.h>
#include <string>
#include <unistd.h>

#include "libport/base/printable.hpp"
#include "libport/base/result.hpp"

namespace porttape {

// A folder of our own for a driver's port, empty again when it goes.
class PrivateFolder {
 public:
  PrivateFolder() = default;
  PrivateFolder(const PrivateFolder&) = delete;
  PrivateFolder& operator=(const PrivateFolder&) = delete;
  ~PrivateFolder() {
    if (!path_.empty()) (void)::rmdir(path_.c_str());
  }

  // Its path. Errc::io. Once.
  Result<std::string> make() {
    std::string path = (std::filesystem::temp_directory_path() / "porttape-XXXXXX").string();
    if (::mkdtemp(path.data()) == nullptr)
      return make_error(Errc::io, fmt::format("folder {}: {}", in_quotes(path), errno_text(errno)));
    path_ = path;
    return path;
  }

 private:
  std::string path_;
};

}  // namespace porttape
