#include "libport/tape/source_mode.hpp"

#include <sys/stat.h>

namespace porttape {

mode_t kept_from_others(const std::string& file) {
  struct stat status {};
  if (::stat(file.c_str(), &status) != 0 || !S_ISREG(status.st_mode)) return 0;
  return ~status.st_mode & (S_IRWXG | S_IRWXO);
}

mode_t kept_from_others(const TapePaths& tape) {
  return kept_from_others(tape.read.string()) | kept_from_others(tape.write.string()) |
         kept_from_others(tape.events.string());
}

}  // namespace porttape
