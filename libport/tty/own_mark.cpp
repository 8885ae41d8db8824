#include "libport/tty/own_mark.hpp"

#include <array>
#include <ctime>
#include <fcntl.h>

namespace porttape {
namespace {

// The nanoseconds within kEvery.
constexpr long kMark = 545'450;
constexpr long kEvery = 1'000'000;
constexpr long kSecond = 1'000'000'000;

}  // namespace

void mark_as_own(int folder, const std::string& name, timespec time) {
  time.tv_nsec += (kMark - time.tv_nsec % kEvery + kEvery) % kEvery;
  time.tv_sec += time.tv_nsec / kSecond;
  time.tv_nsec %= kSecond;
  const std::array<timespec, 2> times{time, time};
  (void)::utimensat(folder, name.c_str(), times.data(), AT_SYMLINK_NOFOLLOW);
}

bool is_marked_as_own(const struct stat& status) { return status.st_mtim.tv_nsec % kEvery == kMark; }

}  // namespace porttape
