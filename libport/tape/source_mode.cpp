#include "libport/tape/source_mode.hpp"

#include <sys/stat.h>

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

}  // namespace porttape
