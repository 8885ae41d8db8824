// LD_PRELOAD: a disk that hangs. While the file $SLOW_DISK_SWITCH exists, each write to and each sync of a
// regular file whose name begins with $SLOW_DISK_FILES takes $SLOW_DISK_MS milliseconds (2000).

#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <stdio.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

#include "tests/support/next_call.hpp"

namespace {

bool is_slow(int fd) {
  const char* const marker = ::getenv("SLOW_DISK_SWITCH");
  const char* const files = ::getenv("SLOW_DISK_FILES");
  if (marker == nullptr || files == nullptr || ::access(marker, F_OK) != 0) return false;
  char link[64];
  char path[4096];
  ::snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  const ssize_t size = ::readlink(link, path, sizeof path);
  const std::size_t length = std::strlen(files);
  return size >= static_cast<ssize_t>(length) && std::strncmp(path, files, length) == 0;
}

void wait_for_disk(int fd) {
  if (!is_slow(fd)) return;
  const char* const given = ::getenv("SLOW_DISK_MS");
  const long ms = given == nullptr ? 2000 : std::strtol(given, nullptr, 10);
  const timespec time{ms / 1000, ms % 1000 * 1'000'000};
  ::nanosleep(&time, nullptr);
}

}  // namespace

extern "C" {

ssize_t writev(int fd, const iovec* parts, int count) {
  static const auto real = porttape::next_call<ssize_t (*)(int, const iovec*, int)>("writev");
  wait_for_disk(fd);
  return real(fd, parts, count);
}

ssize_t write(int fd, const void* data, size_t size) {
  static const auto real = porttape::next_call<ssize_t (*)(int, const void*, size_t)>("write");
  wait_for_disk(fd);
  return real(fd, data, size);
}

int fdatasync(int fd) {
  static const auto real = porttape::next_call<int (*)(int)>("fdatasync");
  wait_for_disk(fd);
  return real(fd);
}

}  // extern "C"
