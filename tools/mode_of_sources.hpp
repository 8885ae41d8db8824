#pragma once

#include <span>
#include <string>
#include <sys/stat.h>
#include <sys/types.h>

#include "libport/tape/source_mode.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// While it lives, what this process makes keeps from the group and from others what one of the sources does.
// It sets the umask, so there is no moment at which a new file is open to more people; threads and children
// have that umask, too.
class ModeOfSources {
 public:
  explicit ModeOfSources(std::span<const TapePaths> tapes) {
    for (const TapePaths& tape : tapes) kept_ |= kept_from_others(tape);
    set();
  }
  explicit ModeOfSources(const TapePaths& tape) : ModeOfSources(std::span(&tape, 1)) {}
  explicit ModeOfSources(const std::string& file) : kept_(kept_from_others(file)) { set(); }
  ModeOfSources(const ModeOfSources&) = delete;
  ModeOfSources& operator=(const ModeOfSources&) = delete;
  ~ModeOfSources() { (void)::umask(before_); }

 private:
  void set() {
    before_ = ::umask(S_IRWXG | S_IRWXO);
    (void)::umask(before_ | kept_);
  }

  mode_t kept_ = 0;
  mode_t before_ = 0;
};

}  // namespace porttape
