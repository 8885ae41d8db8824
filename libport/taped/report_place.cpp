#include "libport/taped/report_place.hpp"

#include <cerrno>
#include <filesystem>
#include <fmt/format.h>
#include <linux/magic.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>
#include <utility>

#include "libport/base/own_name.hpp"
#include "libport/base/printable.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

constexpr int kMostLinks = 40;  // as the kernel follows

// /proc/PID/fd: a link there leads to an open file, its text is no path.
bool is_descriptor(const fs::path& path) {
  struct statfs system {};
  return ::statfs(path.parent_path().c_str(), &system) == 0 && system.f_type == PROC_SUPER_MAGIC;
}

Error trouble(std::string text) { return make_error(Errc::io, std::move(text)); }

}  // namespace

Result<ReportPlace> find_report_place(const std::string& path) {
  std::error_code nowhere;
  fs::path at = fs::absolute(path, nowhere);
  if (nowhere) return trouble(nowhere.message());
  for (int links = 0;; ++links) {
    if (is_descriptor(at)) return ReportPlace{at.string(), ReportPlace::Kind::descriptor};
    struct stat node {};
    if (::lstat(at.c_str(), &node) != 0) {
      if (errno == ENOENT) return ReportPlace{at.string(), ReportPlace::Kind::replaced};
      return trouble(errno_text(errno));
    }
    if (!S_ISLNK(node.st_mode)) {
      if (!S_ISREG(node.st_mode)) return ReportPlace{at.string(), ReportPlace::Kind::written};
      if (links == 0 || is_own_or_root(node.st_uid))
        return ReportPlace{at.string(), ReportPlace::Kind::replaced};
      return trouble(fmt::format("the link leads to {}, which is another user's; name a file of your own",
                                 in_quotes(at.string())));
    }
    if (!is_own_or_root(node.st_uid))
      return trouble(fmt::format("{} is a link that another user made; remove it, or name another file",
                                 in_quotes(at.string())));
    std::error_code error;
    const fs::path next = fs::read_symlink(at, error);
    if (error || links == kMostLinks) return trouble(error ? error.message() : errno_text(ELOOP));
    at = at.parent_path() / next;  // `next` alone where it is absolute
  }
}

}  // namespace porttape
