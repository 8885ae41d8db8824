#include "libport/tape/byte_source.hpp"

#include <algorithm>
#include <cerrno>
#include <fcntl.h>
#include <string_view>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace porttape {
namespace {

std::string_view kind_of_file(mode_t mode) {
  if (S_ISDIR(mode)) return "a folder";
  if (S_ISFIFO(mode)) return "a FIFO";
  if (S_ISCHR(mode) || S_ISBLK(mode)) return "a device";
  if (S_ISSOCK(mode)) return "a socket";
  if (S_ISLNK(mode)) return "a link";
  return "something else";
}

Error cannot_read(const std::string& name, int error_number) {
  const bool ours =
      error_number == EMFILE || error_number == ENFILE || error_number == ENOMEM || error_number == EIO;
  return make_error(ours ? Errc::io : Errc::usage, "cannot read " + name + ": " + errno_text(error_number));
}

Result<void> check_regular(const std::string& name, const struct stat& status) {
  if (S_ISREG(status.st_mode)) return {};
  return make_error(Errc::usage, name + " is " + std::string(kind_of_file(status.st_mode)) +
                                     "; a tape is made of regular files");
}

}  // namespace

ByteSource::Stretch ByteSource::stored(std::uint64_t offset) {
  const Result<std::uint64_t> size = this->size();
  return {offset, size ? std::max(*size, offset) : offset};
}

Result<std::unique_ptr<FileSource>> FileSource::open(const std::filesystem::path& path) {
  return open_at(AT_FDCWD, path.c_str(), true, path.string());
}

Result<std::unique_ptr<FileSource>> FileSource::open_in(int folder, const std::string& name,
                                                        std::string shown) {
  return open_at(folder, name.c_str(), false, std::move(shown));
}

Result<std::unique_ptr<FileSource>> FileSource::open_at(int folder, const char* path, bool follows,
                                                        std::string name) {
  struct stat status {};
  if (::fstatat(folder, path, &status, follows ? 0 : AT_SYMLINK_NOFOLLOW) != 0)
    return cannot_read(name, errno);
  if (const auto regular = check_regular(name, status); !regular) return regular.error();

  // O_NONBLOCK: should a FIFO have taken the file's place by now, the open must not wait for a writer.
  const int how = O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY | (follows ? 0 : O_NOFOLLOW);
  UniqueFd fd(::openat(folder, path, how));
  if (!fd) return cannot_read(name, errno);
  if (::fstat(fd.get(), &status) != 0) return cannot_read(name, errno);
  if (const auto regular = check_regular(name, status); !regular) return regular.error();
  ::posix_fadvise(fd.get(), 0, 0, POSIX_FADV_SEQUENTIAL);
  return std::unique_ptr<FileSource>(new FileSource(std::move(fd), std::move(name)));
}

Result<std::unique_ptr<FileSource>> FileSource::duplicate() const {
  UniqueFd fd(::fcntl(fd_.get(), F_DUPFD_CLOEXEC, 0));
  if (!fd) return make_error(Errc::io, "cannot read " + name_ + ": " + errno_text(errno));
  return std::unique_ptr<FileSource>(new FileSource(std::move(fd), name_));
}

Result<std::size_t> FileSource::read_at(std::uint64_t offset, std::span<Byte> into) {
  std::size_t done = 0;
  while (done < into.size()) {
    const ssize_t got =
        ::pread(fd_.get(), into.data() + done, into.size() - done, static_cast<off_t>(offset + done));
    if (got > 0) {
      done += static_cast<std::size_t>(got);
    } else if (got == 0) {
      break;
    } else if (errno != EINTR) {
      return make_error(Errc::io, "cannot read " + name_ + " at offset " + std::to_string(offset + done) +
                                      ": " + errno_text(errno));
    }
  }
  return done;
}

Result<std::uint64_t> FileSource::size() {
  struct stat status {};
  if (::fstat(fd_.get(), &status) != 0) {
    return make_error(Errc::io, "cannot tell the size of " + name_ + ": " + errno_text(errno));
  }
  return static_cast<std::uint64_t>(status.st_size);
}

ByteSource::Stretch FileSource::stored(std::uint64_t offset) {
  const std::uint64_t end = ByteSource::stored(offset).end;
  const off_t data = ::lseek(fd_.get(), static_cast<off_t>(offset), SEEK_DATA);
  if (data < 0) return errno == ENXIO ? Stretch{end, end} : Stretch{offset, end};
  const off_t hole = ::lseek(fd_.get(), data, SEEK_HOLE);
  return {static_cast<std::uint64_t>(data), hole < data ? end : static_cast<std::uint64_t>(hole)};
}

Result<std::size_t> MemorySource::read_at(std::uint64_t offset, std::span<Byte> into) {
  if (offset >= bytes_.size()) return std::size_t{0};
  const auto from = static_cast<std::size_t>(offset);
  const std::size_t count = std::min(into.size(), bytes_.size() - from);
  std::copy_n(bytes_.data() + from, count, into.data());
  return count;
}

}  // namespace porttape
