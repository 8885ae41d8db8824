#pragma once

#include <array>
#include <cstddef>
#include <sys/types.h>

#include "libport/base/unique_fd.hpp"

namespace porttape {

// Descriptors (pidfd) of the threads whose calls came last: the same few call again and again. Such a one
// stays its thread's, whoever has the number later: what is got by it is that thread's, or nothing.
class KnownThreads {
 public:
  // Nothing (-1) where it is not known.
  [[nodiscard]] int find(pid_t thread) const;
  // Of whoever has that number now; nothing where that cannot be had: a thread that is not its process's
  // first before Linux 6.9, or one that has ended.
  UniqueFd open(pid_t thread);
  // In the place of the one kept longest.
  int keep(pid_t thread, UniqueFd fd);
  void forget(pid_t thread);

 private:
  struct Known {
    pid_t thread = 0;
    UniqueFd fd = {};
  };
  static constexpr std::size_t kMost = 8;

  std::array<Known, kMost> known_;
  std::size_t oldest_ = 0;
  bool opens_any_ = true;
};

}  // namespace porttape
