#include "libport/base/own_name.hpp"

#include <array>
#include <cerrno>
#include <cstdio>
#include <fcntl.h>
#include <limits.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

namespace porttape {

std::optional<FileIdentity> FileIdentity::of(int fd) { return at(fd, {}); }

std::optional<FileIdentity> FileIdentity::at(int folder, const std::string& name) {
  struct statx status {};
  const int flags = AT_SYMLINK_NOFOLLOW | AT_NO_AUTOMOUNT | (name.empty() ? AT_EMPTY_PATH : 0);
  if (::statx(folder, name.c_str(), flags, STATX_INO | STATX_BTIME, &status) != 0) return std::nullopt;
  FileIdentity file;
  file.device_ = ::gnu_dev_makedev(status.stx_dev_major, status.stx_dev_minor);
  file.inode_ = status.stx_ino;
  if ((status.stx_mask & STATX_BTIME) != 0) {
    file.made_s_ = status.stx_btime.tv_sec;
    file.made_ns_ = status.stx_btime.tv_nsec;
  }
  return file;
}

bool is_own_or_root(uid_t user) { return user == 0 || user == ::geteuid(); }

bool remove_if_same(int folder, const std::string& name, const FileIdentity& file) {
  return FileIdentity::at(folder, name) == file && ::unlinkat(folder, name.c_str(), 0) == 0;
}

bool remove_if_same(int folder, const std::string& name, int fd) {
  const std::optional<FileIdentity> file = fd >= 0 ? FileIdentity::of(fd) : std::nullopt;
  return file && remove_if_same(folder, name, *file);
}

std::string link_text(int folder, const std::string& name) {
  std::array<char, PATH_MAX> text{};
  const ssize_t size = ::readlinkat(folder, name.c_str(), text.data(), text.size());
  return {text.data(), static_cast<std::size_t>(size > 0 ? size : 0)};
}

// Not all file systems have the flags of renameat2(), and not all of those have links.
int move_to_free_name(int folder, const std::string& from, const std::string& to) {
  if (::renameat2(folder, from.c_str(), folder, to.c_str(), RENAME_NOREPLACE) == 0) return 0;
  if (errno != EINVAL) return errno;
  if (::linkat(folder, from.c_str(), folder, to.c_str(), 0) == 0) {
    (void)::unlinkat(folder, from.c_str(), 0);
    return 0;
  }
  if (errno != EPERM && errno != EOPNOTSUPP && errno != ENOSYS) return errno;
  if (FileIdentity::at(folder, to)) return EEXIST;
  if (errno != ENOENT) return errno;
  return ::renameat(folder, from.c_str(), folder, to.c_str()) == 0 ? 0 : errno;
}

int exchange_names(int folder, const std::string& one, const std::string& other) {
  return ::renameat2(folder, one.c_str(), folder, other.c_str(), RENAME_EXCHANGE) == 0 ? 0 : errno;
}

int move_over(int folder, const std::string& from, const std::string& to,
              const std::optional<FileIdentity>& old) {
  const int free = move_to_free_name(folder, from, to);
  if (free != EEXIST || !old) return free;
  if (FileIdentity::at(folder, to) != old) return EEXIST;
  if (const int error = exchange_names(folder, from, to); error != 0) {
    if (error != EINVAL) return error;
    return ::renameat(folder, from.c_str(), folder, to.c_str()) == 0 ? 0 : errno;
  }
  if (remove_if_same(folder, from, *old)) return 0;
  // Another file took the name between the check and the exchange.
  (void)exchange_names(folder, from, to);
  return EEXIST;
}

}  // namespace porttape
