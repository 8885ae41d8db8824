#include "libport/tape/new_file.hpp"

#include <cerrno>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <random>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

#include "libport/base/printable.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kBuffered = std::size_t{256} * 1024;

// Nothing: none can be made there, and errno.
UniqueFd create_beside_name(const std::string& path, std::string& name) {
  constexpr int attempts = 100;
  std::random_device random;
  for (int n = 0; n < attempts; ++n) {
    name = (fs::path(path).parent_path() / fmt::format(".new-{:08x}{:08x}", random(), random())).string();
    UniqueFd fd(::open(name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0644));
    if (fd || errno != EEXIST) return fd;
  }
  return {};
}

}  // namespace

Result<NewFile> NewFile::create(const std::string& path, bool overwrite) {
  if (path == "-") return NewFile(Kind::stdout_stream, path);
  if (path.empty()) return make_error(Errc::usage, "the file's name is empty");
  struct stat status {};
  if (::lstat(path.c_str(), &status) == 0) {
    if (!S_ISREG(status.st_mode))
      return make_error(Errc::usage, in_quotes(path) + " is no regular file; name another");
    if (!overwrite)
      return make_error(Errc::usage, in_quotes(path) + " exists already; name another, or --overwrite");
  }
  NewFile file(Kind::file, path);
  file.overwrite_ = overwrite;
  file.fd_ = create_beside_name(path, file.beside_);
  if (!file.fd_) {
    const int error = errno;
    file.beside_.clear();
    if (error == ENOENT)
      return make_error(Errc::usage,
                        fmt::format("{}: its folder does not exist; type mkdir -p {}", in_quotes(path),
                                    shell_word(fs::path(path).parent_path().string())));
    return make_error(Errc::usage,
                      fmt::format("{} cannot be made: {}; name another", in_quotes(path), errno_text(error)));
  }
  return file;
}

NewFile NewFile::in_memory() { return {Kind::memory, "memory"}; }

NewFile::NewFile(NewFile&& other) noexcept
    : kind_(other.kind_),
      path_(std::move(other.path_)),
      beside_(std::exchange(other.beside_, {})),
      fd_(std::move(other.fd_)),
      overwrite_(other.overwrite_),
      buffer_(std::move(other.buffer_)),
      size_(other.size_),
      trouble_(std::move(other.trouble_)) {}

NewFile& NewFile::operator=(NewFile&& other) noexcept {
  if (this == &other) return *this;
  discard();
  kind_ = other.kind_;
  path_ = std::move(other.path_);
  beside_ = std::exchange(other.beside_, {});
  fd_ = std::move(other.fd_);
  overwrite_ = other.overwrite_;
  buffer_ = std::move(other.buffer_);
  size_ = other.size_;
  trouble_ = std::move(other.trouble_);
  return *this;
}

NewFile::~NewFile() { discard(); }

void NewFile::discard() {
  if (!beside_.empty()) (void)::unlink(beside_.c_str());
  beside_.clear();
}

Result<void> NewFile::failed(int error) {
  trouble_ = fmt::format("{} cannot be written: {}", in_quotes(path_), errno_text(error));
  return make_error(Errc::io, trouble_);
}

Result<void> NewFile::flush() {
  if (!trouble_.empty()) return make_error(Errc::io, trouble_);
  if (kind_ == Kind::memory) return {};
  const int fd = kind_ == Kind::stdout_stream ? STDOUT_FILENO : fd_.get();
  for (std::string_view left = buffer_; !left.empty();) {
    const ssize_t size = ::write(fd, left.data(), left.size());
    if (size < 0 && errno == EINTR) continue;
    if (size <= 0) return failed(size < 0 ? errno : EIO);
    left.remove_prefix(static_cast<std::size_t>(size));
  }
  buffer_.clear();
  return {};
}

Result<void> NewFile::add(std::string_view text) {
  buffer_ += text;
  size_ += text.size();
  if (buffer_.size() >= kBuffered || !trouble_.empty()) return flush();
  return {};
}

Result<void> NewFile::add(ByteView bytes) {
  return add(std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

Result<void> NewFile::finish() {
  if (Result<void> flushed = flush(); !flushed) return flushed;
  if (kind_ != Kind::file) return {};
  if (::fsync(fd_.get()) != 0 && errno != EINVAL) return failed(errno);
  if (::close(fd_.release()) != 0) return failed(errno);
  const unsigned flags = overwrite_ ? 0 : RENAME_NOREPLACE;
  if (::renameat2(AT_FDCWD, beside_.c_str(), AT_FDCWD, path_.c_str(), flags) != 0) {
    if (errno == EEXIST)
      return make_error(Errc::usage,
                        in_quotes(path_) + " has been made by somebody else meanwhile; name another");
    // Not all file systems have the flag.
    if (errno != EINVAL || ::link(beside_.c_str(), path_.c_str()) != 0) return failed(errno);
    discard();
  }
  beside_.clear();
  return {};
}

}  // namespace porttape
