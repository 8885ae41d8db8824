#include "libport/base/trusted_folder.hpp"

#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <list>
#include <random>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>
#include <utility>

#include "libport/base/own_name.hpp"
#include "libport/base/printable.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

constexpr int kMostLinks = 40;  // as the kernel follows

Error trouble(const std::string& text) { return make_error(Errc::usage, text); }

Error cannot_open(int error, const std::string& folder) {
  if (error != ENOENT) return trouble("its folder: " + errno_text(error));
  return trouble("its folder does not exist; type mkdir -p " + shell_word(folder));
}

}  // namespace

Result<UniqueFd> open_trusted_folder(const std::string& path) {
  std::error_code error;
  const fs::path absolute = fs::absolute(path, error);
  if (error) return trouble(error.message());
  std::list<fs::path> left(absolute.begin(), absolute.end());
  UniqueFd folder;
  for (int links = 0; !left.empty();) {
    const fs::path part = std::move(left.front());
    left.pop_front();
    if (part.empty()) continue;  // behind a last slash
    UniqueFd next(::openat(folder ? folder.get() : AT_FDCWD, part.c_str(), O_PATH | O_NOFOLLOW | O_CLOEXEC));
    struct stat status {};
    if (!next || ::fstat(next.get(), &status) != 0) return cannot_open(errno, path);
    if (S_ISDIR(status.st_mode)) {
      folder = std::move(next);
      continue;
    }
    if (!S_ISLNK(status.st_mode)) return cannot_open(ENOTDIR, path);
    if (!is_own_or_root(status.st_uid))
      return trouble(
          fmt::format("{} on the way there is a link that another user made; name the folder itself",
                      in_quotes(part.string())));
    const fs::path text = link_text(next.get(), {});
    if (text.empty() || ++links > kMostLinks) return cannot_open(ELOOP, path);
    left.insert(left.begin(), text.begin(), text.end());  // "/" is the first part of an absolute one
  }
  return folder;
}

Result<TrustedName> find_trusted_name(const std::string& path) {
  const fs::path given(path);
  Result<UniqueFd> folder = open_trusted_folder(given.has_parent_path() ? given.parent_path().string() : ".");
  if (!folder) return folder.error();
  return TrustedName{std::move(*folder), given.filename().string()};
}

std::string make_private_folder(int folder, const std::string& prefix) {
  constexpr int attempts = 100;
  std::random_device random;
  for (int n = 0; n < attempts; ++n) {
    std::string name = fmt::format("{}{:06x}", prefix, random() & 0xFFFFFFU);
    if (::mkdirat(folder, name.c_str(), S_IRWXU) == 0) return name;
    if (errno != EEXIST) break;
  }
  return {};
}

}  // namespace porttape
