#include "libport/tape/tape_lock.hpp"

#include <cerrno>
#include <fcntl.h>
#include <sys/stat.h>

#include "libport/base/unique_fd.hpp"

namespace porttape {
namespace {

struct flock whole_file(short type) {
  struct flock lock {};
  lock.l_type = type;
  lock.l_whence = SEEK_SET;
  return lock;
}

bool has_no_locks(int error) {
  return error == ENOLCK || error == EINVAL || error == EOPNOTSUPP || error == ENOSYS;
}

// A lock to read goes with others of its kind. One that has gone meanwhile is taken for a writer's.
bool is_locked_by_writer(int fd) {
  struct flock lock = whole_file(F_RDLCK);
  if (::fcntl(fd, F_OFD_GETLK, &lock) != 0 || lock.l_type != F_UNLCK) return true;
  lock = whole_file(F_WRLCK);
  return ::fcntl(fd, F_OFD_GETLK, &lock) != 0 || lock.l_type != F_RDLCK;
}

}  // namespace

TapeLock lock_tape_file(int fd, int folder, const std::filesystem::path& name) {
  const struct flock lock = whole_file(F_WRLCK);
  if (::fcntl(fd, F_OFD_SETLK, &lock) != 0) {
    if (errno == EAGAIN || errno == EACCES) return is_locked_by_writer(fd) ? TapeLock::taken : TapeLock::read;
    if (!has_no_locks(errno)) return TapeLock::failed;
  }
  struct stat opened {};
  struct stat named {};
  if (::fstat(fd, &opened) != 0) return TapeLock::failed;
  if (::fstatat(folder, name.c_str(), &named, AT_SYMLINK_NOFOLLOW) != 0) {
    return errno == ENOENT ? TapeLock::moved : TapeLock::failed;
  }
  const bool same = opened.st_dev == named.st_dev && opened.st_ino == named.st_ino;
  return same ? TapeLock::held : TapeLock::moved;
}

bool is_being_written(const std::filesystem::path& file) {
  const UniqueFd fd(::open(file.c_str(), O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC));
  return fd && is_being_written(fd.get());
}

bool is_being_written(int fd) {
  struct flock lock = whole_file(F_RDLCK);
  return ::fcntl(fd, F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK;
}

bool is_being_written(const TapePaths& paths) {
  return is_being_written(paths.read) || is_being_written(paths.write) || is_being_written(paths.events);
}

}  // namespace porttape
