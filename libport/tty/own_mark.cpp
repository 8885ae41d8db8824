#include "libport/tty/own_mark.hpp"

#include <array>
#include <ctime>
#include <fcntl.h>

namespace porttape {
namespace {

// The nanoseconds within kEvery.
constexpr long kMark = 4'545'450;
constexpr long kEvery = 10'000'000;
constexpr long kSecond = 1'000'000'000;

}  // namespace

void mark_as_own(const std::string& path) {
  std::array<timespec, 2> times{};
  ::clock_gettime(CLOCK_REALTIME, &times[1]);
  times[1].tv_nsec += (kMark - times[1].tv_nsec % kEvery + kEvery) % kEvery;
  times[1].tv_sec += times[1].tv_nsec / kSecond;
  times[1].tv_nsec %= kSecond;
  times[0] = times[1];
  (void)::utimensat(AT_FDCWD, path.c_str(), times.data(), AT_SYMLINK_NOFOLLOW);
}

bool is_marked_as_own(const struct stat& status) { return status.st_mtim.tv_nsec % kEvery == kMark; }

}  // namespace porttape
