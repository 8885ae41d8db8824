#include "libport/port/report_file.hpp"

#include <cerrno>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <iostream>
#include <sys/stat.h>
#include <unistd.h>

#include "libport/base/unique_fd.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

// A report goes to a regular file by rename; a pipe, /dev/stderr or the like is written to as it is.
bool replaceable(const std::string& path) {
  std::error_code error;
  const fs::file_status status = fs::symlink_status(path, error);
  return !fs::exists(status) || fs::is_regular_file(status);
}

bool write_all(int fd, std::string_view text) {
  while (!text.empty()) {
    const ssize_t n = ::write(fd, text.data(), text.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    text.remove_prefix(static_cast<std::size_t>(n));
  }
  return true;
}

}  // namespace

Result<void> check_report_place(const std::string& path) {
  if (path == "-") return {};
  std::error_code error;
  if (fs::is_directory(path, error))
    return make_error(Errc::usage, fmt::format("report '{}' is a folder; name a file", path));
  const fs::path folder = fs::absolute(path).parent_path();
  if (!fs::is_directory(folder, error)) {
    return make_error(Errc::usage, fmt::format("report '{}': its folder {} does not exist; create it first",
                                               path, folder.string()));
  }
  return {};
}

Result<void> write_report(const std::string& path, std::string_view text) {
  if (path == "-") {
    std::cout << text << std::flush;
    return {};
  }
  std::error_code unresolved;
  const std::string file = fs::weakly_canonical(path, unresolved).string();
  const bool replace = !unresolved && replaceable(file);
  const std::string target = replace ? fmt::format("{}.{}.new", file, ::getpid()) : path;
  // O_NONBLOCK: a pipe that nobody reads is an error, not a wait.
  UniqueFd fd(::open(target.c_str(),
                     O_WRONLY | O_CLOEXEC | O_CREAT | O_NONBLOCK | (replace ? O_TRUNC : O_APPEND), 0644));
  bool ok = fd && write_all(fd.get(), text);
  if (ok) ok = ::close(fd.release()) == 0;
  if (ok && replace) ok = std::rename(target.c_str(), file.c_str()) == 0;
  if (ok) return {};
  const int error_number = errno;
  if (replace) (void)::unlink(target.c_str());
  return make_error(Errc::io,
                    fmt::format("report '{}' cannot be written: {}", path, errno_text(error_number)));
}

}  // namespace porttape
