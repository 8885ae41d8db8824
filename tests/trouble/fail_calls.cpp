// LD_PRELOAD: notes where a program asks the system for something, and makes one of these calls fail.
//
//   TROUBLE_PROGRAM  the name of the program that is meant; its children and others are left alone
//   TROUBLE_PLACES   a file of kPlaces zeroed Places (see below): what was called, from where, how often
//   TROUBLE_TAPES    files that begin so are called "tape", their folder "tapes"
//   TROUBLE          "KIND SITES FIRST COUNT ACTION [NUMBER]": of the calls of that kind from these sites
//   (hexadecimal,
//                    with commas, or *) the COUNT ones from the FIRSTth on
//     errno E        fail with it             short          take or give half of what was asked for
//     hang MS        come back later          clock S        CLOCK_REALTIME stands S seconds off from then on
//     kill           SIGKILL instead          kill-after     SIGKILL behind it
//     torn           half of it, then SIGKILL
//
// A *kind* is the function's name, for calls on a descriptor with what it is behind it ("write.master"), for
// ioctl with the request. A *site* is the return address in the program, less its load address; where a
// library made the call, that of the program's call into it. `new` is noted only while TROUBLE asks for it,
// or TROUBLE_MEMORY is there. Nothing before main().

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <link.h>
#include <netdb.h>
#include <new>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <sys/epoll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/random.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/statfs.h>
#include <sys/syscall.h>
#include <sys/sysmacros.h>
#include <sys/timerfd.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>
#include <unwind.h>

#include "tests/support/next_call.hpp"

namespace {

constexpr std::size_t kPlaces = 4096;
constexpr std::size_t kKindSize = 32;

// One entry of TROUBLE_PLACES; 64 bytes, read by the runner.
struct Place {
  std::atomic<std::uint32_t> state;  // 0 free, 1 being filled, 2 filled
  std::uint32_t unused;
  std::array<char, kKindSize> kind;
  std::uint64_t site;
  std::atomic<std::uint64_t> calls;
  std::atomic<std::uint64_t> troubled;
};
static_assert(sizeof(Place) == 64);

struct Plan {
  std::array<char, kKindSize> kind{};
  std::array<char, 512> sites{};
  unsigned long long first = 0;
  unsigned long long count = 0;
  std::array<char, 16> action{};
  long number = 0;

  [[nodiscard]] bool does(const char* what) const { return std::strcmp(action.data(), what) == 0; }
};

// What is to become of a call.
struct Turn {
  bool fails = false;
  bool half = false;
  bool last = false;  // SIGKILL behind it
};

std::atomic<bool> armed = false;
bool with_memory = false;
Place* places = nullptr;
Plan plan;
bool has_plan = false;
std::atomic<std::uint64_t> local_matched = 0;
std::atomic<long> clock_offset = 0;
std::uintptr_t program_begin = 0;
std::uintptr_t program_end = 0;
thread_local bool inside = false;

int find_program(dl_phdr_info* info, std::size_t, void*) {
  program_begin = info->dlpi_addr;
  for (int i = 0; i < info->dlpi_phnum; ++i) {
    const ElfW(Phdr)& part = info->dlpi_phdr[i];
    if (part.p_type == PT_LOAD)
      program_end = std::max(program_end, info->dlpi_addr + part.p_vaddr + part.p_memsz);
  }
  return 1;  // the program is the first
}

bool in_program(std::uintptr_t address) { return address >= program_begin && address < program_end; }

_Unwind_Reason_Code look_at_frame(_Unwind_Context* context, void* found) {
  const std::uintptr_t address = _Unwind_GetIP(context);
  if (!in_program(address)) return _URC_NO_REASON;
  *static_cast<std::uintptr_t*>(found) = address;
  return _URC_END_OF_STACK;
}

std::uint64_t site_of(void* caller) {
  std::uintptr_t address = 0;
  std::memcpy(&address, &caller, sizeof address);
  if (!in_program(address)) {
    address = program_begin;
    (void)_Unwind_Backtrace(look_at_frame, &address);
  }
  return address - program_begin;
}

Place* place_of(const char* kind, std::uint64_t site) {
  std::uint64_t hash = site * 0x9E3779B97F4A7C15U;
  for (const char* c = kind; *c != '\0'; ++c) hash = (hash ^ static_cast<unsigned char>(*c)) * 0x100000001B3U;
  for (std::size_t i = 0; i < kPlaces; ++i) {
    Place& place = places[(hash + i) % kPlaces];
    std::uint32_t expected = 0;
    if (place.state.compare_exchange_strong(expected, 1)) {
      std::strncpy(place.kind.data(), kind, kKindSize - 1);
      place.site = site;
      place.state = 2;
      return &place;
    }
    while (place.state != 2) {
    }
    if (place.site == site && std::strcmp(place.kind.data(), kind) == 0) return &place;
  }
  return nullptr;
}

bool is_meant(std::uint64_t site) {
  if (plan.sites[0] == '*') return true;
  const char* at = plan.sites.data();
  while (*at != '\0') {
    char* end = nullptr;
    if (std::strtoull(at, &end, 16) == site) return true;
    if (end == at) return false;
    at = *end == ',' ? end + 1 : end;
  }
  return false;
}

void sleep_ms(long ms) {
  timespec left{ms / 1000, ms % 1000 * 1'000'000};
  while (::nanosleep(&left, &left) != 0 && errno == EINTR) {
  }
}

void die() { (void)::syscall(SYS_kill, ::getpid(), SIGKILL); }

// Notes the call and says what becomes of it; errno is set where it fails.
Turn turn_of(const char* kind, void* caller) {
  Turn turn;
  if (!armed || inside) return turn;
  inside = true;
  const int error = errno;
  const std::uint64_t site = site_of(caller);
  Place* const place = place_of(kind, site);
  if (place != nullptr) ++place->calls;
  errno = error;
  if (has_plan && std::strcmp(kind, plan.kind.data()) == 0 && is_meant(site)) {
    const std::uint64_t number = ++local_matched;
    if (number >= plan.first && number - plan.first < plan.count) {
      if (place != nullptr) ++place->troubled;
      if (plan.does("kill")) die();
      if (plan.does("hang")) sleep_ms(plan.number);
      if (plan.does("clock")) clock_offset = plan.number;
      turn.fails = plan.does("errno");
      turn.half = plan.does("short") || plan.does("torn");
      turn.last = plan.does("torn") || plan.does("kill-after");
      if (turn.fails) errno = static_cast<int>(plan.number);
    }
  }
  inside = false;
  return turn;
}

// A call that gives -1 and errno.
template <class Real>
auto call(const char* kind, void* caller, Real real) -> decltype(real()) {
  const Turn turn = turn_of(kind, caller);
  if (turn.fails) return static_cast<decltype(real())>(-1);
  const auto result = real();
  if (turn.last) die();
  return result;
}

// The same, for a number of bytes.
template <class Real>
ssize_t transfer(const char* kind, void* caller, std::size_t size, Real real) {
  const Turn turn = turn_of(kind, caller);
  if (turn.fails) return -1;
  const ssize_t result = real(turn.half && size > 1 ? size / 2 : size);
  if (turn.last) die();
  return result;
}

struct Name {
  std::array<char, kKindSize> text{};
  operator const char*() const { return text.data(); }
};

bool is_tape(int fd) {
  const char* const tapes = ::getenv("TROUBLE_TAPES");
  if (tapes == nullptr) return false;
  std::array<char, 64> link{};
  std::array<char, 4096> path{};
  (void)::snprintf(link.data(), link.size(), "/proc/self/fd/%d", fd);
  (void)::syscall(SYS_readlink, link.data(), path.data(), path.size() - 1);
  return std::strncmp(path.data(), tapes, std::strlen(tapes)) == 0;
}

const char* class_of(int fd) {
  struct stat status {};
  if (::syscall(SYS_fstat, fd, &status) != 0) return "bad";
  switch (status.st_mode & S_IFMT) {
    case S_IFREG:
      return is_tape(fd) ? "tape" : "file";
    case S_IFSOCK:
      return "socket";
    case S_IFIFO:
      return "pipe";
    case S_IFDIR:
      return is_tape(fd) ? "tapes" : "folder";
    case S_IFCHR: {
      const unsigned number = major(status.st_rdev);
      if (number == 5 && minor(status.st_rdev) == 2) return "master";
      return number >= 136 && number <= 143 ? "slave" : "node";
    }
    default:
      return "anonymous";
  }
}

Name of_fd(const char* function, int fd) {
  Name name;
  if (!armed || inside) return name;
  const int error = errno;
  (void)::snprintf(name.text.data(), name.text.size(), "%s.%s", function, class_of(fd));
  errno = error;
  return name;
}

Name of_request(unsigned long request) {
  struct Known {
    unsigned long number;
    const char* text;
  };
  static constexpr std::array<Known, 12> kKnown = {{{0x802C542A, "TCGETS2"},
                                                    {0x402C542B, "TCSETS2"},
                                                    {TIOCPKT, "TIOCPKT"},
                                                    {TIOCEXCL, "TIOCEXCL"},
                                                    {TIOCNXCL, "TIOCNXCL"},
                                                    {FIONREAD, "FIONREAD"},
                                                    {TIOCOUTQ, "OUTQ"},
                                                    {TIOCMBIS, "TIOCMBIS"},
                                                    {TIOCMBIC, "TIOCMBIC"},
                                                    {TIOCMGET, "TIOCMGET"},
                                                    {FIONBIO, "FIONBIO"},
                                                    {TCFLSH, "TCFLSH"}}};
  Name name;
  for (const Known& known : kKnown) {
    if (known.number == request) {
      (void)::snprintf(name.text.data(), name.text.size(), "ioctl.%s", known.text);
      return name;
    }
  }
  (void)::snprintf(name.text.data(), name.text.size(), "ioctl.%lx", request);
  return name;
}

void arm() {
  const char* const program = ::getenv("TROUBLE_PROGRAM");
  const char* const file = ::getenv("TROUBLE_PLACES");
  if (program == nullptr || file == nullptr || std::strcmp(program, program_invocation_short_name) != 0)
    return;
  const int fd = ::open(file, O_RDWR | O_CLOEXEC);
  if (fd < 0) return;
  void* const mapped = ::mmap(nullptr, kPlaces * sizeof(Place), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  (void)::close(fd);
  if (mapped == MAP_FAILED) return;
  places = static_cast<Place*>(mapped);
  (void)::dl_iterate_phdr(find_program, nullptr);
  (void)::prctl(PR_SET_PDEATHSIG, SIGKILL);  // nothing is left running where the runner is ended
  if (const char* const text = ::getenv("TROUBLE")) {
    has_plan = std::sscanf(text, "%31s %511s %llu %llu %15s %ld", plan.kind.data(), plan.sites.data(),
                           &plan.first, &plan.count, plan.action.data(), &plan.number) >= 5;
    if (!has_plan) {
      (void)std::fprintf(stderr, "fail_calls: TROUBLE='%s' is not understood\n", text);
      std::_Exit(99);
    }
  }
  with_memory =
      ::getenv("TROUBLE_MEMORY") != nullptr || (has_plan && std::strcmp(plan.kind.data(), "new") == 0);
  armed = true;
}

using Main = int (*)(int, char**, char**);
Main real_main = nullptr;

int main_with_trouble(int count, char** arguments, char** environment) {
  arm();
  return real_main(count, arguments, environment);
}

void* allocate(void* caller, const char* name, std::size_t size) {
  static const auto real = porttape::next_call<void* (*)(std::size_t)>(name);
  if (with_memory && turn_of("new", caller).fails) throw std::bad_alloc();
  return real(size);
}

}  // namespace

#pragma GCC diagnostic ignored "-Wshadow"  // flock and stat are structs, too

// A wrapper: RESULT NAME(PARAMETERS), called on with ARGUMENTS. ON: a descriptor that gives the kind its
// class.
#define WRAP(RESULT, NAME, PARAMETERS, ARGUMENTS)                                    \
  RESULT NAME PARAMETERS {                                                           \
    static const auto real = porttape::next_call<RESULT(*) PARAMETERS>(#NAME);       \
    return call(#NAME, __builtin_return_address(0), [&] { return real ARGUMENTS; }); \
  }
#define WRAP_ON(FD, RESULT, NAME, PARAMETERS, ARGUMENTS)                                        \
  RESULT NAME PARAMETERS {                                                                      \
    static const auto real = porttape::next_call<RESULT(*) PARAMETERS>(#NAME);                  \
    return call(of_fd(#NAME, FD), __builtin_return_address(0), [&] { return real ARGUMENTS; }); \
  }

extern "C" {

int __libc_start_main(Main main, int count, char** arguments, void (*init)(), void (*fini)(),
                      void (*loader_fini)(), void* stack_end);
int __libc_start_main(Main main, int count, char** arguments, void (*init)(), void (*fini)(),
                      void (*loader_fini)(), void* stack_end) {
  using Start = int (*)(Main, int, char**, void (*)(), void (*)(), void (*)(), void*);
  real_main = main;
  return porttape::next_call<Start>("__libc_start_main")(main_with_trouble, count, arguments, init, fini,
                                                         loader_fini, stack_end);
}

int open(const char* path, int flags, ...) {
  static const auto real = porttape::next_call<int (*)(const char*, int, ...)>("open");
  va_list rest;
  va_start(rest, flags);
  const unsigned mode = (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(rest, unsigned) : 0;
  va_end(rest);
  return call("open", __builtin_return_address(0), [&] { return real(path, flags, mode); });
}
int openat(int folder, const char* path, int flags, ...) {
  static const auto real = porttape::next_call<int (*)(int, const char*, int, ...)>("openat");
  va_list rest;
  va_start(rest, flags);
  const unsigned mode = (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(rest, unsigned) : 0;
  va_end(rest);
  return call(of_fd("openat", folder), __builtin_return_address(0),
              [&] { return real(folder, path, flags, mode); });
}
int fcntl(int fd, int command, ...) {
  static const auto real = porttape::next_call<int (*)(int, int, ...)>("fcntl");
  va_list rest;
  va_start(rest, command);
  void* const argument = va_arg(rest, void*);
  va_end(rest);
  Name name;
  (void)::snprintf(name.text.data(), name.text.size(), "fcntl.%d", command);
  return call(name, __builtin_return_address(0), [&] { return real(fd, command, argument); });
}
int ioctl(int fd, unsigned long request, ...) noexcept {
  static const auto real = porttape::next_call<int (*)(int, unsigned long, ...)>("ioctl");
  va_list rest;
  va_start(rest, request);
  void* const argument = va_arg(rest, void*);
  va_end(rest);
  return call(of_request(request), __builtin_return_address(0), [&] { return real(fd, request, argument); });
}

ssize_t read(int fd, void* data, size_t size) {
  static const auto real = porttape::next_call<ssize_t (*)(int, void*, size_t)>("read");
  return transfer(of_fd("read", fd), __builtin_return_address(0), size,
                  [&](size_t n) { return real(fd, data, n); });
}
ssize_t pread(int fd, void* data, size_t size, off_t at) {
  static const auto real = porttape::next_call<ssize_t (*)(int, void*, size_t, off_t)>("pread");
  return transfer(of_fd("pread", fd), __builtin_return_address(0), size,
                  [&](size_t n) { return real(fd, data, n, at); });
}
ssize_t write(int fd, const void* data, size_t size) {
  static const auto real = porttape::next_call<ssize_t (*)(int, const void*, size_t)>("write");
  return transfer(of_fd("write", fd), __builtin_return_address(0), size,
                  [&](size_t n) { return real(fd, data, n); });
}
ssize_t pwrite(int fd, const void* data, size_t size, off_t at) {
  static const auto real = porttape::next_call<ssize_t (*)(int, const void*, size_t, off_t)>("pwrite");
  return transfer(of_fd("pwrite", fd), __builtin_return_address(0), size,
                  [&](size_t n) { return real(fd, data, n, at); });
}
ssize_t writev(int fd, const iovec* parts, int count) {
  static const auto real = porttape::next_call<ssize_t (*)(int, const iovec*, int)>("writev");
  const Turn turn = turn_of(of_fd("writev", fd), __builtin_return_address(0));
  if (turn.fails) return -1;
  ssize_t result = 0;
  if (turn.half) {
    std::size_t size = 0;
    for (int i = 0; i < count; ++i) size += parts[i].iov_len;
    std::array<iovec, 16> some{};
    int used = 0;
    for (std::size_t left = std::max<std::size_t>(size / 2, 1); used < count && used < 16 && left > 0;
         ++used) {
      const auto i = static_cast<std::size_t>(used);
      some[i] = parts[used];
      some[i].iov_len = std::min(some[i].iov_len, left);
      left -= some[i].iov_len;
    }
    result = real(fd, some.data(), used);
  } else {
    result = real(fd, parts, count);
  }
  if (turn.last) die();
  return result;
}
ssize_t recv(int fd, void* data, size_t size, int flags) {
  static const auto real = porttape::next_call<ssize_t (*)(int, void*, size_t, int)>("recv");
  return transfer("recv", __builtin_return_address(0), size,
                  [&](size_t n) { return real(fd, data, n, flags); });
}
ssize_t send(int fd, const void* data, size_t size, int flags) {
  static const auto real = porttape::next_call<ssize_t (*)(int, const void*, size_t, int)>("send");
  return transfer("send", __builtin_return_address(0), size,
                  [&](size_t n) { return real(fd, data, n, flags); });
}

WRAP(ssize_t, recvfrom, (int fd, void* data, size_t size, int flags, sockaddr* from, socklen_t* length),
     (fd, data, size, flags, from, length))
WRAP(ssize_t, recvmsg, (int fd, msghdr* message, int flags), (fd, message, flags))
WRAP(ssize_t, sendto,
     (int fd, const void* data, size_t size, int flags, const sockaddr* to, socklen_t length),
     (fd, data, size, flags, to, length))
WRAP(ssize_t, sendmsg, (int fd, const msghdr* message, int flags), (fd, message, flags))

WRAP_ON(fd, int, fsync, (int fd), (fd))
WRAP_ON(fd, int, fdatasync, (int fd), (fd))
WRAP_ON(fd, int, ftruncate, (int fd, off_t size) noexcept, (fd, size))
WRAP_ON(fd, int, fstat, (int fd, struct stat* status) noexcept, (fd, status))
WRAP_ON(fd, int, flock, (int fd, int operation) noexcept, (fd, operation))
WRAP_ON(fd, int, fchmod, (int fd, mode_t mode) noexcept, (fd, mode))
WRAP_ON(fd, int, tcflush, (int fd, int queue) noexcept, (fd, queue))
WRAP_ON(fd, int, dup, (int fd) noexcept, (fd))
WRAP(int, dup2, (int fd, int other) noexcept, (fd, other))
WRAP(int, pipe, (int* ends) noexcept, (ends))
WRAP(int, pipe2, (int* ends, int flags) noexcept, (ends, flags))
WRAP(int, stat, (const char* path, struct stat* status) noexcept, (path, status))
WRAP(int, lstat, (const char* path, struct stat* status) noexcept, (path, status))
WRAP(int, fstatat, (int folder, const char* path, struct stat* status, int flags) noexcept,
     (folder, path, status, flags))
WRAP(int, statfs, (const char* path, struct statfs* status) noexcept, (path, status))
WRAP(int, access, (const char* path, int mode) noexcept, (path, mode))
WRAP(int, faccessat, (int folder, const char* path, int mode, int flags) noexcept,
     (folder, path, mode, flags))
WRAP(int, chmod, (const char* path, mode_t mode) noexcept, (path, mode))
WRAP(int, chown, (const char* path, uid_t owner, gid_t group) noexcept, (path, owner, group))
WRAP(int, rename, (const char* from, const char* to) noexcept, (from, to))
WRAP(int, renameat, (int from_folder, const char* from, int to_folder, const char* to) noexcept,
     (from_folder, from, to_folder, to))
WRAP(int, link, (const char* from, const char* to) noexcept, (from, to))
WRAP(int, symlink, (const char* target, const char* path) noexcept, (target, path))
WRAP(ssize_t, readlink, (const char* path, char* target, size_t size) noexcept, (path, target, size))
WRAP(int, unlink, (const char* path) noexcept, (path))
WRAP(int, unlinkat, (int folder, const char* path, int flags) noexcept, (folder, path, flags))
WRAP(int, mkdir, (const char* path, mode_t mode) noexcept, (path, mode))
WRAP(int, utimensat, (int folder, const char* path, const timespec* times, int flags) noexcept,
     (folder, path, times, flags))

WRAP(int, socket, (int family, int type, int protocol) noexcept, (family, type, protocol))
WRAP(int, bind, (int fd, const sockaddr* address, socklen_t size) noexcept, (fd, address, size))
WRAP(int, listen, (int fd, int backlog) noexcept, (fd, backlog))
WRAP(int, accept4, (int fd, sockaddr* address, socklen_t* size, int flags), (fd, address, size, flags))
WRAP(int, connect, (int fd, const sockaddr* address, socklen_t size), (fd, address, size))
WRAP(int, shutdown, (int fd, int how) noexcept, (fd, how))
WRAP(int, getsockname, (int fd, sockaddr* address, socklen_t* size) noexcept, (fd, address, size))
WRAP(int, getpeername, (int fd, sockaddr* address, socklen_t* size) noexcept, (fd, address, size))
WRAP(int, getsockopt, (int fd, int level, int name, void* value, socklen_t* size) noexcept,
     (fd, level, name, value, size))
WRAP(int, setsockopt, (int fd, int level, int name, const void* value, socklen_t size) noexcept,
     (fd, level, name, value, size))

WRAP(int, epoll_create1, (int flags) noexcept, (flags))
int epoll_ctl(int epoll, int operation, int fd, epoll_event* event) noexcept {
  static const auto real = porttape::next_call<int (*)(int, int, int, epoll_event*)>("epoll_ctl");
  const char* const kind = operation == EPOLL_CTL_ADD   ? "epoll_ctl.add"
                           : operation == EPOLL_CTL_DEL ? "epoll_ctl.del"
                                                        : "epoll_ctl.mod";
  return call(kind, __builtin_return_address(0), [&] { return real(epoll, operation, fd, event); });
}
WRAP(int, epoll_wait, (int epoll, epoll_event* events, int count, int timeout),
     (epoll, events, count, timeout))
WRAP(int, eventfd, (unsigned value, int flags) noexcept, (value, flags))
WRAP(int, timerfd_create, (clockid_t clock, int flags) noexcept, (clock, flags))
WRAP(int, timerfd_settime, (int fd, int flags, const itimerspec* time, itimerspec* old) noexcept,
     (fd, flags, time, old))
WRAP(int, poll, (pollfd * fds, nfds_t count, int timeout), (fds, count, timeout))
WRAP(int, inotify_init1, (int flags) noexcept, (flags))
WRAP(int, inotify_add_watch, (int fd, const char* path, uint32_t mask) noexcept, (fd, path, mask))
WRAP(int, inotify_rm_watch, (int fd, int watch) noexcept, (fd, watch))

WRAP(int, posix_openpt, (int flags), (flags))
WRAP(int, grantpt, (int fd) noexcept, (fd))
WRAP(int, unlockpt, (int fd) noexcept, (fd))
int ptsname_r(int fd, char* path, size_t size) noexcept {
  static const auto real = porttape::next_call<int (*)(int, char*, size_t)>("ptsname_r");
  return turn_of("ptsname_r", __builtin_return_address(0)).fails ? errno : real(fd, path, size);
}
int isatty(int fd) noexcept {
  static const auto real = porttape::next_call<int (*)(int)>("isatty");
  return turn_of("isatty", __builtin_return_address(0)).fails ? 0 : real(fd);
}

WRAP(pid_t, fork, () noexcept, ())
WRAP(pid_t, waitpid, (pid_t pid, int* status, int options), (pid, status, options))
WRAP(int, getrlimit, (__rlimit_resource_t resource, rlimit* limit) noexcept, (resource, limit))
WRAP(int, setrlimit, (__rlimit_resource_t resource, const rlimit* limit) noexcept, (resource, limit))
WRAP(int, getrusage, (__rusage_who_t who, rusage* usage) noexcept, (who, usage))
WRAP(int, gethostname, (char* name, size_t size) noexcept, (name, size))
WRAP(ssize_t, getrandom, (void* data, size_t size, unsigned flags), (data, size, flags))
int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*run)(void*),
                   void* argument) noexcept {
  using Real = int (*)(pthread_t*, const pthread_attr_t*, void* (*)(void*), void*);
  static const auto real = porttape::next_call<Real>("pthread_create");
  if (turn_of("pthread_create", __builtin_return_address(0)).fails) return errno;
  return real(thread, attributes, run, argument);
}
int getaddrinfo(const char* host, const char* service, const addrinfo* hints, addrinfo** found) {
  using Real = int (*)(const char*, const char*, const addrinfo*, addrinfo**);
  static const auto real = porttape::next_call<Real>("getaddrinfo");
  if (turn_of("getaddrinfo", __builtin_return_address(0)).fails) return EAI_AGAIN;
  return real(host, service, hints, found);
}

// A failed close has closed.
int close(int fd) {
  static const auto real = porttape::next_call<int (*)(int)>("close");
  const Turn turn = turn_of(of_fd("close", fd), __builtin_return_address(0));
  const int error = errno;
  const int result = real(fd);
  if (turn.last) die();
  if (!turn.fails) return result;
  errno = error;
  return -1;
}

int clock_gettime(clockid_t clock, timespec* time) noexcept {
  static const auto real = porttape::next_call<int (*)(clockid_t, timespec*)>("clock_gettime");
  const int result = real(clock, time);
  if (clock != CLOCK_REALTIME || !armed) return result;
  (void)turn_of("clock_gettime", __builtin_return_address(0));
  time->tv_sec += clock_offset;
  return result;
}

}  // extern "C"

void* operator new(std::size_t size) { return allocate(__builtin_return_address(0), "_Znwm", size); }
void* operator new[](std::size_t size) { return allocate(__builtin_return_address(0), "_Znwm", size); }
