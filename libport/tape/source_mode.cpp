#include "libport/tape/source_mode.hpp"

#include <cerrno>
#include <fcntl.h>
#include <sys/stat.h>

#include "libport/base/printable.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape {

namespace {

mode_t kept_by(const struct stat& status) {
  return S_ISREG(status.st_mode) ? ~status.st_mode & (S_IRWXG | S_IRWXO) : 0;
}

}  // namespace

mode_t kept_from_others(const std::string& file) {
  struct stat status {};
  return ::stat(file.c_str(), &status) == 0 ? kept_by(status) : 0;
}

mode_t kept_from_others(int fd) {
  struct stat status {};
  return ::fstat(fd, &status) == 0 ? kept_by(status) : 0;
}

mode_t kept_from_others(const TapePaths& tape) {
  return kept_from_others(tape.read.string()) | kept_from_others(tape.write.string()) |
         kept_from_others(tape.events.string());
}

mode_t kept_from_others(std::span<const TapePaths> tapes) {
  mode_t kept = 0;
  for (const TapePaths& tape : tapes) kept |= kept_from_others(tape);
  return kept;
}

int keep_from_others(int fd, mode_t kept) {
  if (kept == 0) return 0;
  struct stat status {};
  if (::fstat(fd, &status) != 0) return errno;
  const mode_t now = status.st_mode & 07777U;
  const mode_t less = now & ~kept;
  if (less == now || ::fchmod(fd, less) == 0) return 0;
  const bool has_modes = errno != EPERM && errno != EOPNOTSUPP && errno != ENOSYS;
  return has_modes ? errno : 0;
}

Result<void> keep_from_others(const TapePaths& tape, mode_t kept) {
  for (const std::filesystem::path* const file : {&tape.read, &tape.write, &tape.events}) {
    const UniqueFd fd(::open(file->c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
    const int error = fd ? keep_from_others(fd.get(), kept) : errno;
    if (error == 0 || error == ENOENT) continue;
    return make_error(Errc::io, in_quotes(file->string()) + ": " + errno_text(error));
  }
  return {};
}

ModeOfSources::ModeOfSources(mode_t kept) : before_(::umask(S_IRWXG | S_IRWXO)) {
  (void)::umask(before_ | kept);
}

ModeOfSources::~ModeOfSources() { (void)::umask(before_); }

}  // namespace porttape
