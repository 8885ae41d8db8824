#include "libport/taped/report_place.hpp"

#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <linux/magic.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>
#include <utility>

#include "libport/base/own_name.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/trusted_folder.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

constexpr int kMostLinks = 40;  // as the kernel follows

// /proc/PID/fd: a link there leads to an open file, its text is no path.
bool is_of_descriptors(int folder) {
  struct statfs system {};
  return ::fstatfs(folder, &system) == 0 && system.f_type == PROC_SUPER_MAGIC;
}

Error trouble(std::string text) { return make_error(Errc::io, std::move(text)); }

}  // namespace

Result<ReportPlace> find_report_place(const std::string& path) {
  std::error_code nowhere;
  fs::path at = fs::absolute(path, nowhere);
  if (nowhere) return trouble(nowhere.message());
  for (int links = 0;; ++links) {
    Result<TrustedName> found = find_trusted_name(at.string());
    if (!found) return trouble(found.error().message);
    const int folder = found->folder.get();
    const std::string name = found->name;
    const auto place = [&](ReportPlace::Kind kind) {
      return ReportPlace{std::move(found->folder), name, at.string(), kind};
    };
    if (is_of_descriptors(folder)) return place(ReportPlace::Kind::descriptor);
    struct stat node {};
    if (::fstatat(folder, name.c_str(), &node, AT_SYMLINK_NOFOLLOW) != 0) {
      if (errno == ENOENT) return place(ReportPlace::Kind::replaced);
      return trouble(errno_text(errno));
    }
    if (!S_ISLNK(node.st_mode)) {
      if (!S_ISREG(node.st_mode)) return place(ReportPlace::Kind::written);
      if (links == 0 || is_own_or_root(node.st_uid)) return place(ReportPlace::Kind::replaced);
      return trouble(fmt::format("the link leads to {}, which is another user's; name a file of your own",
                                 in_quotes(at.string())));
    }
    if (!is_own_or_root(node.st_uid))
      return trouble(fmt::format("{} is a link that another user made; remove it, or name another file",
                                 in_quotes(at.string())));
    const fs::path next = link_text(folder, name);
    if (next.empty() || links == kMostLinks) return trouble(errno_text(next.empty() ? errno : ELOOP));
    at = at.parent_path() / next;  // `next` alone where it is absolute
  }
}

}  // namespace porttape
