#include "libport/supervise/call.hpp"

#include <algorithm>
#include <cerrno>
#include <climits>
#include <fcntl.h>
#include <fmt/format.h>
#include <linux/seccomp.h>
#include <string_view>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/sysmacros.h>
#include <sys/uio.h>
#include <unistd.h>

#include "libport/base/unique_fd.hpp"
#include "libport/supervise/call_filter.hpp"
#include "libport/supervise/pending_signals.hpp"

namespace porttape {
namespace {

// Where process_vm_readv() and its like are forbidden (a container's filter).
UniqueFd open_memory(pid_t thread, int mode) {
  return UniqueFd(::open(fmt::format("/proc/{}/mem", thread).c_str(), mode | O_CLOEXEC));
}

}  // namespace

Call::Call(int listener, const seccomp_notif& told)
    : listener_(listener),
      id_(told.id),
      thread_(static_cast<pid_t>(told.pid)),
      number_(native_call_number(told.data.arch, told.data.nr)),
      small_(is_32_bit(told.data.arch)) {
  std::ranges::copy(told.data.args, arguments_.begin());
}

bool Call::waits() const { return ::ioctl(listener_, SECCOMP_IOCTL_NOTIF_ID_VALID, &id_) == 0; }

std::optional<std::uint64_t> Call::device_of(int fd) const {
  std::array<char, 64> path{};
  *fmt::format_to_n(path.data(), path.size() - 1, "/proc/{}/fd/{}", thread_, fd).out = '\0';
  struct stat status {};
  if (::stat(path.data(), &status) != 0 || !S_ISCHR(status.st_mode)) return std::nullopt;
  return status.st_rdev;
}

// A thread that is not its process's first has no pidfd of its own before Linux 6.9.
UniqueFd Call::duplicate(int fd) const {
  UniqueFd process(static_cast<int>(::syscall(SYS_pidfd_open, thread_, 0)));
  if (!process) process.reset(static_cast<int>(::syscall(SYS_pidfd_open, process_of(thread_), 0)));
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
  if (!waits()) return false;
  if (::process_vm_writev(thread_, &local, 1, &remote, 1, 0) == size) return true;
  if (errno == EFAULT) return false;
  const UniqueFd memory = open_memory(thread_, O_WRONLY);
  return memory && waits() &&
         ::pwrite(memory.get(), what.data(), what.size(), static_cast<off_t>(address)) == size;
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
