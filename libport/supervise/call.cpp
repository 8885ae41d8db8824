#include "libport/supervise/call.hpp"

#include <algorithm>
#include <cerrno>
#include <climits>
#include <fcntl.h>
#include <fmt/format.h>
#include <linux/kcmp.h>
#include <linux/seccomp.h>
#include <string_view>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>
#include <utility>

#include "libport/base/unique_fd.hpp"
#include "libport/supervise/call_filter.hpp"
#include "libport/supervise/known_threads.hpp"
#include "libport/supervise/pending_signals.hpp"
#include "libport/supervise/port_devices.hpp"

namespace porttape {
namespace {

constexpr std::uint64_t kDevTty = 5U << 8U;  // 5:0

// Where process_vm_readv() and its like are forbidden (a container's filter).
UniqueFd open_memory(pid_t thread, int mode) {
  return UniqueFd(::open(fmt::format("/proc/{}/mem", thread).c_str(), mode | O_CLOEXEC));
}

}  // namespace

Call::Call(int listener, KnownThreads& threads, const seccomp_notif& told, bool stays)
    : listener_(listener),
      threads_(&threads),
      id_(told.id),
      thread_(static_cast<pid_t>(told.pid)),
      number_(native_call_number(told.data.arch, told.data.nr)),
      small_(is_32_bit(told.data.arch)),
      stays_(stays) {
  std::ranges::copy(told.data.args, arguments_.begin());
}

bool Call::waits() const {
  int result = -1;
  do {
    result = ::ioctl(listener_, SECCOMP_IOCTL_NOTIF_ID_VALID, &id_);
  } while (result != 0 && errno == EINTR);
  return result == 0;
}

Call Call::for_later() const {
  Call later = *this;
  later.seen_ = false;
  return later;
}

// To look at a duplicate takes half as long as to walk through /proc; that is for where there is none.
std::optional<std::uint64_t> Call::device_of(int fd) const {
  struct stat status {};
  UniqueFd file = duplicate_by_thread(fd);
  if (file) {
    if (::fstat(file.get(), &status) != 0) return std::nullopt;
  } else {
    std::array<char, 64> path{};
    *fmt::format_to_n(path.data(), path.size() - 1, "/proc/{}/fd/{}", thread_, fd).out = '\0';
    if (::stat(path.data(), &status) != 0) return std::nullopt;
  }
  if (!S_ISCHR(status.st_mode)) return std::nullopt;
  if (status.st_rdev != kDevTty) return status.st_rdev;
  // A descriptor of it stays what it was opened as, whatever terminal its process has now.
  if (!file) file = duplicate(fd);
  unsigned number = 0;
  return file && ::ioctl(file.get(), TIOCGDEV, &number) == 0 ? device_number(number) : status.st_rdev;
}

bool Call::has_as(int fd, int ours) const {
  return ::syscall(SYS_kcmp, ::getpid(), thread_, KCMP_FILE, ours, fd) == 0;
}

// By a known thread's descriptor it is that thread's, which had the number before the call came and has it
// still. A new one may be of another that has got the number.
UniqueFd Call::duplicate_by_thread(int fd) const {
  if (const int known = threads_->find(thread_); known >= 0) {
    UniqueFd file(static_cast<int>(::syscall(SYS_pidfd_getfd, known, fd, 0)));
    seen_ = static_cast<bool>(file);
    if (file || errno != ESRCH) return file;
    threads_->forget(thread_);
  }
  UniqueFd opened = threads_->open(thread_);
  if (!opened || !waits()) return {};
  const int known = threads_->keep(thread_, std::move(opened));
  UniqueFd file(static_cast<int>(::syscall(SYS_pidfd_getfd, known, fd, 0)));
  seen_ = static_cast<bool>(file);
  return file;
}

// A thread that is not its process's first has no pidfd of its own before Linux 6.9.
UniqueFd Call::duplicate(int fd) const {
  if (UniqueFd file = duplicate_by_thread(fd)) return file;
  const UniqueFd process(static_cast<int>(::syscall(SYS_pidfd_open, process_of(thread_), 0)));
  if (!process || !waits()) return {};
  return UniqueFd(static_cast<int>(::syscall(SYS_pidfd_getfd, process.get(), fd, 0)));
}

bool Call::read(std::uint64_t address, std::span<std::byte> into) const {
  const iovec local{into.data(), into.size()};
  // NOLINTNEXTLINE(performance-no-int-to-ptr): an address in another process
  const iovec remote{reinterpret_cast<void*>(address), into.size()};
  const auto size = static_cast<ssize_t>(into.size());
  if (::process_vm_readv(thread_, &local, 1, &remote, 1, 0) == size) return true;
  if (errno == EFAULT) return false;
  const UniqueFd memory = open_memory(thread_, O_RDONLY);
  return memory && ::pread(memory.get(), into.data(), into.size(), static_cast<off_t>(address)) == size;
}

bool Call::write(std::uint64_t address, std::span<const std::byte> what) const {
  const iovec local{const_cast<std::byte*>(what.data()), what.size()};
  // NOLINTNEXTLINE(performance-no-int-to-ptr): an address in another process
  const iovec remote{reinterpret_cast<void*>(address), what.size()};
  const auto size = static_cast<ssize_t>(what.size());
  if (!(stays_ && seen_) && !waits()) return false;
  if (::process_vm_writev(thread_, &local, 1, &remote, 1, 0) == size) return true;
  if (errno == EFAULT) return false;
  const UniqueFd memory = open_memory(thread_, O_WRONLY);
  return memory && waits() &&
         ::pwrite(memory.get(), what.data(), what.size(), static_cast<off_t>(address)) == size;
}

bool Call::is_closed() const {
  return !open_memory(thread_, O_RDONLY) && (errno == EACCES || errno == EPERM);
}

// Up to the page's end first: the next one may not be there.
std::optional<std::string> Call::read_path(std::uint64_t address) const {
  constexpr std::uint64_t kPage = 4096;
  std::string path;
  while (path.size() < PATH_MAX) {
    std::array<char, 256> part{};
    const std::uint64_t at = address + path.size();
    const std::size_t size = std::min<std::uint64_t>(part.size(), kPage - at % kPage);
    if (!read(at, std::as_writable_bytes(std::span(part.data(), size)))) return std::nullopt;
    const std::string_view text(part.data(), size);
    path.append(text.substr(0, text.find('\0')));
    if (text.find('\0') != std::string_view::npos) return path;
  }
  return std::nullopt;
}

}  // namespace porttape
