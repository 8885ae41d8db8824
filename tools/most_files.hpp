#pragma once

#include <optional>
#include <sys/resource.h>

namespace porttape {

// While it lives this process may have as many files open as the system lets it. What is started meanwhile
// inherits that: it is for one who has started its programs already.
class MostFiles {
 public:
  MostFiles() {
    rlimit limit{};
    if (::getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur == limit.rlim_max) return;
    const rlimit most{.rlim_cur = limit.rlim_max, .rlim_max = limit.rlim_max};
    if (::setrlimit(RLIMIT_NOFILE, &most) == 0) before_ = limit;
  }
  ~MostFiles() {
    if (before_) (void)::setrlimit(RLIMIT_NOFILE, &*before_);
  }
  MostFiles(const MostFiles&) = delete;
  MostFiles& operator=(const MostFiles&) = delete;

 private:
  std::optional<rlimit> before_;
};

}  // namespace porttape
