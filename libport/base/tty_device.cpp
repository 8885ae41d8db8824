#include "libport/base/tty_device.hpp"

#include <fcntl.h>
#include <sys/sysmacros.h>

namespace porttape {
namespace {

constexpr unsigned kFirstPty = 136;
constexpr unsigned kLastPty = 143;

}  // namespace

bool is_pty(std::uint64_t number) { return major(number) >= kFirstPty && major(number) <= kLastPty; }

std::optional<TtyDevice> tty_device_in(const struct stat& status) {
  if (!S_ISCHR(status.st_mode)) return std::nullopt;
  TtyDevice device{.number = status.st_rdev};
  if (is_pty(device.number)) device.file_system = status.st_dev;
  return device;
}

std::optional<TtyDevice> tty_device_at(const std::string& path) {
  struct stat status {};
  return ::stat(path.c_str(), &status) == 0 ? tty_device_in(status) : std::nullopt;
}

std::optional<TtyDevice> tty_device_of(int fd) {
  const int flags = ::fcntl(fd, F_GETFL);
  struct stat status {};
  if (flags < 0 || (flags & O_PATH) != 0 || ::fstat(fd, &status) != 0) return std::nullopt;
  return tty_device_in(status);
}

}  // namespace porttape
