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

#include "libport/base/own_name.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/trusted_folder.hpp"
#include "libport/tape/signals_held.hpp"
#include "libport/tape/tape_lock.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;

// As a tape: what is made of one tells no more people.
constexpr mode_t kMode = 0640;
constexpr int kToLook = O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC;
constexpr std::size_t kBuffered = std::size_t{256} * 1024;

std::string hidden_name(const std::string& path) {
  std::random_device random;
  return (fs::path(path).parent_path() / fmt::format(".new-{:08x}{:08x}", random(), random())).string();
}

// The name of a path, in its folder.
std::string name_in_folder(const std::string& path) {
  const std::string name = fs::path(path).filename().string();
  return name.empty() ? "." : name;
}

Error cannot_make(const std::string& path, int error) {
  return make_error(Errc::usage,
                    fmt::format("{} cannot be made: {}; name another", in_quotes(path), errno_text(error)));
}

// 0 or the errno.
int name_file(const UniqueFd& unnamed, int folder, const std::string& name) {
  const std::string own = fmt::format("/proc/self/fd/{}", unnamed.get());
  return ::linkat(AT_FDCWD, own.c_str(), folder, name.c_str(), AT_SYMLINK_FOLLOW) == 0 ? 0 : errno;
}

Error is_live_tape(const std::string& path) {
  return make_error(Errc::usage, in_quotes(path) +
                                     " is being written by a recording, which cannot be "
                                     "replaced; end that one first, or name another file");
}

Error is_read_locked(const std::string& path) {
  return make_error(Errc::usage, in_quotes(path) +
                                     " is locked by a program that reads it, not by a recording; end that "
                                     "program (lslocks shows it), or name another file");
}

}  // namespace

Result<NewFile> NewFile::create(const std::string& path, bool overwrite) {
  if (path == "-") return NewFile(Kind::stdout_stream, path);
  if (path.empty()) return make_error(Errc::usage, "the file's name is empty");
  Result<TrustedName> place = find_trusted_name(path);
  if (!place) return make_error(Errc::usage, in_quotes(path) + ": " + place.error().message);
  return create_in(std::move(place->folder), path, overwrite);
}

Result<NewFile> NewFile::create_in(UniqueFd folder, const std::string& path, bool overwrite) {
  NewFile file(Kind::file, path);
  file.folder_ = std::move(folder);
  file.name_ = name_in_folder(path);
  file.overwrite_ = overwrite;
  struct stat status {};
  if (::fstatat(file.folder_.get(), file.name_.c_str(), &status, AT_SYMLINK_NOFOLLOW) == 0) {
    if (!S_ISREG(status.st_mode))
      return make_error(Errc::usage, in_quotes(path) + " is no regular file; name another");
    if (!overwrite)
      return make_error(Errc::usage, in_quotes(path) + " exists already; name another, or --overwrite");
    const UniqueFd existing(::openat(file.folder_.get(), file.name_.c_str(), O_RDONLY | kToLook));
    if (existing && is_being_written(existing.get())) return is_live_tape(path);
  }
  file.fd_.reset(::openat(file.folder_.get(), ".", O_WRONLY | O_TMPFILE | O_CLOEXEC, kMode));
  // What kernels and file systems without such files say.
  const bool unknown = !file.fd_ && (errno == EOPNOTSUPP || errno == EISDIR || errno == EINVAL);
  if (!file.fd_ && (!unknown || !file.create_hidden())) return cannot_make(path, errno);
  return file;
}

// Makes the file under a hidden name. False: errno says why.
bool NewFile::create_hidden() {
  constexpr int attempts = 100;
  for (int n = 0; n < attempts; ++n) {
    const std::string hidden = hidden_name(path_);
    const int how = O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC;
    const SignalsHeld held;
    fd_.reset(::openat(folder_.get(), name_in_folder(hidden).c_str(), how, kMode));
    if (fd_) beside_ = Leftover(hidden);
    if (fd_ || errno != EEXIST) return static_cast<bool>(fd_);
  }
  return false;
}

Result<void> NewFile::keep(mode_t from_others) {
  const int error = kind_ == Kind::file ? keep_from_others(fd_.get(), from_others) : 0;
  return error == 0 ? Result<void>() : failed(error);
}

NewFile NewFile::in_memory() { return {Kind::memory, "memory"}; }

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
  UniqueFd existing;
  if (overwrite_) {
    if (Result<void> locked = lock_existing(existing); !locked) return locked;
    if (Result<void> kept = keep_existing_mode(); !kept) return kept;
  }
  const int error = publish();
  if (error == EEXIST)
    return make_error(Errc::usage,
                      in_quotes(path_) + " has been made by somebody else meanwhile; name another");
  if (error != 0) return failed(error);
  return ::close(fd_.release()) == 0 ? Result<void>() : failed(errno);
}

Result<void> NewFile::keep_existing_mode() {
  const UniqueFd existing(::openat(folder_.get(), name_.c_str(), O_PATH | O_NOFOLLOW | O_CLOEXEC));
  return existing ? keep(kept_from_others(existing.get())) : Result<void>();
}

// A tape's file is only ever replaced by the one who holds its lock. One that cannot be opened to be written
// has none.
Result<void> NewFile::lock_existing(UniqueFd& existing) const {
  constexpr int rounds = 100;
  for (int round = 0; round < rounds; ++round) {
    existing.reset(::openat(folder_.get(), name_.c_str(), O_WRONLY | kToLook));
    if (!existing) return {};
    const TapeLock lock = lock_tape_file(existing.get(), folder_.get(), name_);
    if (lock == TapeLock::taken) return is_live_tape(path_);
    if (lock == TapeLock::read) return is_read_locked(path_);
    if (lock != TapeLock::moved) return {};
  }
  return is_live_tape(path_);
}

// 0 or the errno; EEXIST: the name has been taken meanwhile.
int NewFile::publish() {
  const int folder = folder_.get();
  if (beside_.path().empty()) {
    const std::string first = overwrite_ ? hidden_name(path_) : path_;
    const SignalsHeld held;
    if (const int error = name_file(fd_, folder, name_in_folder(first)); error != 0) return error;
    if (!overwrite_) return 0;
    beside_ = Leftover(first);
  }
  const std::string hidden = name_in_folder(beside_.path());
  int error = 0;
  if (!overwrite_) {
    error = move_to_free_name(folder, hidden, name_);
  } else if (::renameat(folder, hidden.c_str(), folder, name_.c_str()) != 0) {
    error = errno;
  }
  if (error == 0) beside_.keep();
  return error;
}

}  // namespace porttape
