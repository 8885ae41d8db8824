#include "libport/supervise/known_threads.hpp"

#include <algorithm>
#include <cerrno>
#include <fcntl.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <utility>

namespace porttape {
namespace {

constexpr unsigned kAnyThread = O_EXCL;  // PIDFD_THREAD of Linux 6.9

}  // namespace

int KnownThreads::find(pid_t thread) const {
  const auto* const known = std::ranges::find(known_, thread, &Known::thread);
  return known == known_.end() ? -1 : known->fd.get();
}

UniqueFd KnownThreads::open(pid_t thread) {
  if (opens_any_) {
    UniqueFd fd(static_cast<int>(::syscall(SYS_pidfd_open, thread, kAnyThread)));
    if (fd || errno != EINVAL) return fd;
    opens_any_ = false;
  }
  return UniqueFd(static_cast<int>(::syscall(SYS_pidfd_open, thread, 0)));
}

int KnownThreads::keep(pid_t thread, UniqueFd fd) {
  Known& place = known_.at(oldest_);
  oldest_ = (oldest_ + 1) % kMost;
  place = {thread, std::move(fd)};
  return place.fd.get();
}

void KnownThreads::forget(pid_t thread) {
  for (Known& known : known_) {
    if (known.thread == thread) known = {};
  }
}

}  // namespace porttape
