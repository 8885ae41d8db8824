#include "tests/simulation/disk.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdarg>
#include <fcntl.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>
#include <vector>

namespace porttape::simulation {
namespace {

const Disk::Policy* the_policy = nullptr;
std::vector<int> the_files;  // descriptors

bool is_file(int fd) { return the_policy != nullptr && std::ranges::find(the_files, fd) != the_files.end(); }

// Takes the time that the call takes. The trouble, with errno set where it fails.
Disk::Trouble ask(Disk::Call call) {
  const Disk::Trouble trouble = (*the_policy)(call);
  Kernel* const kernel = Kernel::current();
  if (kernel != nullptr && trouble.takes.count() > 0) kernel->sleep(trouble.takes);
  errno = trouble.error;
  return trouble;
}

}  // namespace

Disk::Disk(Policy policy) : policy_(std::move(policy)) {
  the_files.clear();
  the_policy = &policy_;
}
Disk::~Disk() { the_policy = nullptr; }

std::string_view name_of(Disk::Call call) {
  switch (call) {
    case Disk::Call::open:
      return "open";
    case Disk::Call::write:
      return "write";
    case Disk::Call::sync:
      return "sync";
    case Disk::Call::truncate:
      break;
  }
  return "truncate";
}

}  // namespace porttape::simulation

using porttape::simulation::ask;
using porttape::simulation::Disk;
using porttape::simulation::is_file;
using porttape::simulation::the_files;
using porttape::simulation::the_policy;

extern "C" {

int openat(int folder, const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = (flags & O_CREAT) != 0 ? va_arg(arguments, mode_t) : 0;
  va_end(arguments);
  const bool made = the_policy != nullptr && (flags & O_CREAT) != 0;
  if (made && ask(Disk::Call::open).error != 0) return -1;
  const int fd = static_cast<int>(::syscall(SYS_openat, folder, path, flags, mode));
  if (made && fd >= 0) the_files.push_back(fd);
  return fd;
}

int close(int fd) {
  std::erase(the_files, fd);
  return static_cast<int>(::syscall(SYS_close, fd));
}

ssize_t writev(int fd, const iovec* parts, int count) {
  if (!is_file(fd)) return ::syscall(SYS_writev, fd, parts, count);
  const Disk::Trouble trouble = ask(Disk::Call::write);
  if (trouble.error != 0) return -1;
  std::vector<iovec> taken(parts, parts + count);
  std::size_t left = trouble.most_bytes;
  for (iovec& part : taken) {
    part.iov_len = std::min(part.iov_len, left);
    left -= part.iov_len;
  }
  return ::syscall(SYS_writev, fd, taken.data(), count);
}

int fdatasync(int fd) {
  if (!is_file(fd)) return static_cast<int>(::syscall(SYS_fdatasync, fd));
  return ask(Disk::Call::sync).error != 0 ? -1 : 0;  // what it is for is not simulated
}

int ftruncate(int fd, off_t size) noexcept {
  if (is_file(fd) && ask(Disk::Call::truncate).error != 0) return -1;
  return static_cast<int>(::syscall(SYS_ftruncate, fd, size));
}
}
