#include "libport/supervise/call.hpp"

#include <algorithm>
#include <cerrno>
#include <climits>
#include <fcntl.h>
#include <fmt/format.h>
#include <fstream>
#include <linux/kcmp.h>
#include <linux/seccomp.h>
#include <sstream>
#include <string_view>
#include <sys/ioctl.h>
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

// /proc/PID/mem, for where process_vm_readv() and its like are forbidden (a container's filter) or not built
// in.
UniqueFd open_memory(pid_t thread, int mode) {
  return UniqueFd(::open(fmt::format("/proc/{}/mem", thread).c_str(), mode | O_CLOEXEC));
}

// Whether what process_vm_*() gave says no more than that it may not be used here.
bool is_forbidden(ssize_t done) { return done < 0 && (errno == EPERM || errno == ENOSYS); }

// Whether the program itself may reach all of it so: /proc/PID/mem asks for no such right. By the list in
// proc_pid_maps(5), whose ranges are in order.
bool may_reach(pid_t thread, std::uint64_t address, std::size_t size, char right) {
  std::ifstream maps(fmt::format("/proc/{}/maps", thread));
  const std::uint64_t end = address + size;
  for (std::string line; address < end && std::getline(maps, line);) {
    std::istringstream words(line);
    std::uint64_t from = 0;
    std::uint64_t to = 0;
    char dash = 0;
    std::string rights;
    if (!(words >> std::hex >> from >> dash >> to >> rights)) return false;
    if (to <= address) continue;
    if (from > address || rights.find(right) == std::string::npos) return false;
    address = to;
  }
  return address >= end;
}

// Whether it is open as a place alone (O_PATH), by the flags in proc_pid_fdinfo(5).
bool is_place_only(pid_t thread, int fd) {
  std::ifstream info(fmt::format("/proc/{}/fdinfo/{}", thread, fd));
  for (std::string word; info >> word;) {
    if (word != "flags:") continue;
    unsigned flags = 0;
    return !(info >> std::oct >> flags) || (flags & O_PATH) != 0;
  }
  return true;
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
std::optional<TtyDevice> Call::device_of(int fd) const {
  UniqueFd file = duplicate_by_thread(fd);
  std::optional<TtyDevice> device;
  if (file)
    device = tty_device_of(file.get());
  else if (!is_place_only(thread_, fd))
    device = tty_device_at(fmt::format("/proc/{}/fd/{}", thread_, fd));
  if (!device || device->number != kDevTty) return device;
  // A descriptor of it stays what it was opened as, whatever terminal its process has now.
  if (!file) file = duplicate(fd);
  unsigned number = 0;
  if (file && ::ioctl(file.get(), TIOCGDEV, &number) == 0) device->number = device_number(number);
  return device;
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
  const ssize_t done = ::process_vm_readv(thread_, &local, 1, &remote, 1, 0);
  if (done == size) return true;
  if (!is_forbidden(done) || !may_reach(thread_, address, into.size(), 'r')) return false;
  const UniqueFd memory = open_memory(thread_, O_RDONLY);
  return memory && ::pread(memory.get(), into.data(), into.size(), static_cast<off_t>(address)) == size;
}

bool Call::write(std::uint64_t address, std::span<const std::byte> what) const {
  const iovec local{const_cast<std::byte*>(what.data()), what.size()};
  // NOLINTNEXTLINE(performance-no-int-to-ptr): an address in another process
  const iovec remote{reinterpret_cast<void*>(address), what.size()};
  const auto size = static_cast<ssize_t>(what.size());
  if (!(stays_ && seen_) && !waits()) return false;
  const ssize_t done = ::process_vm_writev(thread_, &local, 1, &remote, 1, 0);
  if (done == size) return true;
  if (!is_forbidden(done) || !may_reach(thread_, address, what.size(), 'w')) return false;
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
    if (text.find('\0') != std::string_view::npos)
      return path.size() < PATH_MAX ? std::optional(std::move(path)) : std::nullopt;
  }
  return std::nullopt;
}

}  // namespace porttape
