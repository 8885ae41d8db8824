#include "libport/taped/report_place.hpp"

#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <linux/magic.h>
#include <optional>
#include <sys/stat.h>
#include <sys/sysmacros.h>
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

struct ReportTarget {
  bool replaced = false;                 // by a new file of that name
  std::string name;                      // replaced: in the folder
  struct stat folder {};                 // replaced
  std::optional<struct stat> file = {};  // what is there now, or what is written to
};

std::optional<ReportTarget> target_of(const std::string& path) {
  ReportTarget target;
  struct stat file {};
  if (path == "-") {
    if (::fstat(STDOUT_FILENO, &file) != 0) return std::nullopt;
    target.file = file;
    return target;
  }
  const Result<ReportPlace> place = find_report_place(path);
  if (!place || ::fstat(place->folder.get(), &target.folder) != 0) return std::nullopt;
  target.replaced = place->kind == ReportPlace::Kind::replaced;
  target.name = place->name;
  const int follow = place->kind == ReportPlace::Kind::descriptor ? 0 : AT_SYMLINK_NOFOLLOW;
  if (::fstatat(place->folder.get(), place->name.c_str(), &file, follow) == 0) target.file = file;
  return target;
}

bool is_same_file(const struct stat& one, const struct stat& other) {
  return one.st_dev == other.st_dev && one.st_ino == other.st_ino;
}

bool drops_all(const struct stat& file) {
  return S_ISCHR(file.st_mode) && file.st_rdev == makedev(1, 3);  // /dev/null
}

}  // namespace

bool is_same_report_place(const std::string& one, const std::string& other) {
  const std::optional<ReportTarget> first = target_of(one);
  const std::optional<ReportTarget> second = target_of(other);
  if (!first || !second) return false;
  // Two hard links of one file are two places: each gets a file of its own.
  if (first->replaced && second->replaced)
    return first->name == second->name && is_same_file(first->folder, second->folder);
  return first->file && second->file && is_same_file(*first->file, *second->file) && !drops_all(*first->file);
}

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
