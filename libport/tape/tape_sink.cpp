#include "libport/tape/tape_sink.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <fcntl.h>
#include <string>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#include "libport/base/own_name.hpp"
#include "libport/tape/tape_lock.hpp"

namespace porttape {
namespace {

constexpr mode_t kMode = 0640;

iovec part(ByteView bytes) { return {const_cast<Byte*>(bytes.data()), bytes.size()}; }

}  // namespace

std::unique_ptr<FileSink> FileSink::create(int folder, const std::filesystem::path& name, int& error,
                                           mode_t kept_from_others) {
  UniqueFd fd(::openat(folder, name.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC,
                       kMode & ~kept_from_others));
  error = fd ? 0 : errno;
  if (!fd) return nullptr;
  if (const TapeLock lock = lock_tape_file(fd.get(), folder, name); lock != TapeLock::held) {
    error = lock == TapeLock::failed ? errno : EEXIST;
    if (lock == TapeLock::failed) (void)remove_if_same(folder, name, fd.get());
    return nullptr;  // else it is somebody else's by now
  }
  UniqueFd sync_fd(::fcntl(fd.get(), F_DUPFD_CLOEXEC, 0));
  error = sync_fd ? 0 : errno;
  if (!sync_fd) {
    (void)remove_if_same(folder, name, fd.get());
    return nullptr;
  }
  return std::unique_ptr<FileSink>(new FileSink(std::move(fd), std::move(sync_fd)));
}

std::unique_ptr<FileSink> FileSink::create_unnamed(int folder, int& error, mode_t kept_from_others) {
  UniqueFd fd(::openat(folder, ".", O_WRONLY | O_APPEND | O_TMPFILE | O_CLOEXEC, kMode & ~kept_from_others));
  // What kernels and file systems without them say.
  const bool unknown = !fd && (errno == EISDIR || errno == EINVAL || errno == ENOENT || errno == ENOSYS);
  error = fd ? 0 : unknown ? EOPNOTSUPP : errno;
  if (!fd) return nullptr;
  UniqueFd sync_fd(::fcntl(fd.get(), F_DUPFD_CLOEXEC, 0));
  error = sync_fd ? 0 : errno;
  if (!sync_fd) return nullptr;
  return std::unique_ptr<FileSink>(new FileSink(std::move(fd), std::move(sync_fd)));
}

int FileSink::link(int folder, const std::filesystem::path& name) const {
  const std::string own = "/proc/self/fd/" + std::to_string(fd_.get());
  return ::linkat(AT_FDCWD, own.c_str(), folder, name.c_str(), AT_SYMLINK_FOLLOW) == 0 ? 0 : errno;
}

// A short write is followed by a second one, which tells why.
TapeSink::Appended FileSink::append(ByteView head, ByteView body) {
  Appended done;
  while (head.size() + body.size() > 0) {
    const std::array parts{part(head), part(body)};
    const ssize_t written = ::writev(fd_.get(), parts.data(), static_cast<int>(parts.size()));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) {
      done.error = written < 0 ? errno : ENOSPC;
      return done;
    }
    const auto count = static_cast<std::size_t>(written);
    const std::size_t of_head = count < head.size() ? count : head.size();
    head = head.subspan(of_head);
    body = body.subspan(count - of_head);
    done.bytes += count;
  }
  return done;
}

int FileSink::truncate(std::uint64_t size) {
  return ::ftruncate(fd_.get(), static_cast<off_t>(size)) == 0 ? 0 : errno;
}

// A file system that cannot sync is no failure.
TapeSink::Sync FileSink::syncer() {
  return [sync_fd = std::weak_ptr<UniqueFd>(sync_fd_)] {
    const std::shared_ptr<UniqueFd> fd = sync_fd.lock();
    if (!fd) return 0;
    if (::fdatasync(fd->get()) != 0 && errno != EINVAL && errno != ENOSYS) return errno;
    struct stat file {};
    return ::fstat(fd->get(), &file) == 0 && file.st_nlink == 0 ? ENOENT : 0;
  };
}

int FileSink::close() {
  sync_fd_.reset();
  return ::close(fd_.release()) == 0 ? 0 : errno;
}

int WholeAppender::append(ByteView head, ByteView body) {
  if (const int error = repair(); error != 0) return error;
  const TapeSink::Appended done = sink_->append(head, body);
  const std::size_t whole = head.size() + body.size();
  if (done.error == 0 && done.bytes == whole) {
    size_ += whole;
    return 0;
  }
  torn_ = done.bytes > 0;
  repair();  // if this fails too, it is tried again before the next append
  return done.error != 0 ? done.error : ENOSPC;
}

WholeAppender::Kept WholeAppender::append_parts(ByteView parts, std::span<const std::size_t> ends) {
  if (const int error = repair(); error != 0) return {0, error};
  const TapeSink::Appended done = sink_->append({}, parts);
  const auto first_torn = std::ranges::upper_bound(ends, done.bytes);
  const auto kept = static_cast<std::size_t>(first_torn - ends.begin());
  const std::size_t whole = kept == 0 ? 0 : ends[kept - 1];
  size_ += whole;
  torn_ = done.bytes > whole;
  repair();
  const bool all = kept == ends.size();
  return {kept, all ? 0 : done.error != 0 ? done.error : ENOSPC};
}

int WholeAppender::repair() {
  if (!torn_) return 0;
  const int error = sink_->truncate(size_);
  torn_ = error != 0;
  return error;
}

}  // namespace porttape
