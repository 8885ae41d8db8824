// tap_program TTY RESULT STEP…: does the steps to a tty of its own, one after another, and writes a line of
// what came of each. What is written there is answered by the test.
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <linux/aio_abi.h>
#include <linux/fuse.h>
#include <linux/openat2.h>
#include <poll.h>
#include <sched.h>
#include <string>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <termios.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include "tests/supervise/crowd.hpp"

namespace {

int line = -1;
FILE* out = nullptr;
std::string results;
const char* path = nullptr;
volatile std::uintptr_t no_address = 8;  // which the compiler does not know to be bad

void on_alarm(int) {}

const char* error_name() {
  switch (errno) {
    case EAGAIN:
      return "EAGAIN";
    case EINTR:
      return "EINTR";
    case EFAULT:
      return "EFAULT";
    case EINVAL:
      return "EINVAL";
    case ENOENT:
      return "ENOENT";
    case EEXIST:
      return "EEXIST";
    case EIO:
      return "EIO";
    case EBADF:
      return "EBADF";
    default:
      return "other";
  }
}

void say(const std::string& what, ssize_t result, const std::string& more = {}) {
  if (result < 0) {
    std::fprintf(out, "%s %s\n", what.c_str(), error_name());
  } else {
    std::fprintf(out, "%s %zd%s%s\n", what.c_str(), result, more.empty() ? "" : " ", more.c_str());
  }
  std::fflush(out);
}

void open_line(int flags) { line = ::open(path, O_RDWR | O_NOCTTY | flags); }

// Answers what the kernel asks of a file system (linux/fuse.h) that has a link to the device, `device`. For
// each name and for the link's text it opens a file of its own, as such servers do.
[[noreturn]] void serve_files(int requests) {
  static char room[256 * 1024];
  struct {
    fuse_out_header header;
    union {
      fuse_init_out init;
      fuse_attr_out attributes;
      fuse_entry_out entry;
      char text[64];
    } body;
  } answer;
  for (;;) {
    const ssize_t size = ::read(requests, room, sizeof(room));
    if (size < 0 && errno == EINTR) continue;
    if (size <= 0) std::_Exit(0);  // unmounted
    const auto* const asked = reinterpret_cast<const fuse_in_header*>(room);
    std::memset(&answer, 0, sizeof(answer));
    answer.header = {.len = sizeof(answer.header), .error = 0, .unique = asked->unique};
    if (asked->opcode == FUSE_INIT) {
      answer.body.init.major = FUSE_KERNEL_VERSION;
      answer.body.init.minor = 31;
      answer.body.init.max_write = 4096;
      answer.header.len += sizeof(answer.body.init);
    } else if (asked->opcode == FUSE_GETATTR) {
      answer.body.attributes.attr.ino = 1;
      answer.body.attributes.attr.mode = S_IFDIR | 0755;
      answer.body.attributes.attr.nlink = 1;
      answer.header.len += sizeof(answer.body.attributes);
    } else if (asked->opcode == FUSE_LOOKUP && std::strcmp(room + sizeof(*asked), "device") == 0) {
      ::close(::open("/proc/self/status", O_RDONLY));
      answer.body.entry.nodeid = answer.body.entry.attr.ino = 2;
      answer.body.entry.attr.mode = S_IFLNK | 0777;
      answer.body.entry.attr.nlink = 1;
      answer.header.len += sizeof(answer.body.entry);
    } else if (asked->opcode == FUSE_LOOKUP) {
      ::close(::open("/proc/self/status", O_RDONLY));
      answer.header.error = -ENOENT;
    } else if (asked->opcode == FUSE_READLINK) {
      ::close(::open("/proc/self/status", O_RDONLY));
      std::strncpy(answer.body.text, path, sizeof(answer.body.text) - 1);
      answer.header.len += static_cast<std::uint32_t>(std::strlen(answer.body.text));
    } else if (asked->opcode == FUSE_FORGET) {
      continue;  // has no answer
    } else {
      answer.header.error = -ENOSYS;
    }
    (void)!::write(requests, &answer, answer.header.len);
  }
}

// Opens a file of a file system that a child of its own serves.
void do_open_served() {
  const std::string folder = results + ".files";
  const int requests = ::open("/dev/fuse", O_RDWR | O_CLOEXEC);
  const std::string options = "fd=" + std::to_string(requests) + ",rootmode=40000,user_id=0,group_id=0";
  ::mkdir(folder.c_str(), 0700);
  if (requests < 0 ||
      ::mount("porttape-test", folder.c_str(), "fuse", MS_NOSUID | MS_NODEV, options.c_str()) != 0)
    return say("nofuse", 0);
  const pid_t server = ::fork();
  if (server == 0) serve_files(requests);
  ::close(requests);
  say("served", ::open((folder + "/name").c_str(), O_RDONLY));
  const int device = ::open((folder + "/device").c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK);
  say("written", ::write(device, "by a link", 9));
  ::close(device);
  ::umount2(folder.c_str(), MNT_DETACH);
  ::kill(server, SIGKILL);
  ::waitpid(server, nullptr, 0);
}

// Its descriptor of the line ends with the program that it was, and becomes one of its results.
void do_become() {
  ::fcntl(line, F_SETFD, FD_CLOEXEC);
  say("before", ::write(line, "before", 6));
  std::fclose(out);
  ::execl("/proc/self/exe", "tap_program", path, ("+" + results).c_str(), "became", nullptr);
  std::_Exit(6);
}

void set_reads(int vmin, int vtime, bool lines) {
  termios made{};
  ::tcgetattr(line, &made);
  ::cfmakeraw(&made);
  if (lines) made.c_lflag |= ICANON;
  made.c_cc[VMIN] = static_cast<cc_t>(vmin);
  made.c_cc[VTIME] = static_cast<cc_t>(vtime);
  ::tcsetattr(line, TCSANOW, &made);
}

void read_some(std::size_t size) {
  std::string bytes(size, '\0');
  const ssize_t got = ::read(line, bytes.data(), size);
  bytes.resize(static_cast<std::size_t>(got > 0 ? got : 0));
  say("read", got, bytes);
}

// As many, by any reads.
void read_all(std::size_t size) {
  std::string bytes;
  while (bytes.size() < size) {
    char some[256];
    const ssize_t got = ::read(line, some, std::min(sizeof(some), size - bytes.size()));
    if (got > 0) {
      bytes.append(some, static_cast<std::size_t>(got));
    } else if (got == 0 || errno != EINTR) {
      return say("all", got, bytes);
    }
  }
  say("all", static_cast<ssize_t>(size), bytes);
}

void set_alarm(int ms, bool restarts) {
  struct sigaction action {};
  action.sa_handler = on_alarm;
  action.sa_flags = restarts ? SA_RESTART : 0;
  ::sigaction(SIGALRM, &action, nullptr);
  const itimerval timer = {{0, ms * 1000}, {0, ms * 1000}};  // again and again: the first may be early
  ::setitimer(ITIMER_REAL, &timer, nullptr);
}

// A poll tells only of as many as VMIN says.
void await_bytes(int count) {
  for (int ready = 0; ::ioctl(line, FIONREAD, &ready) == 0 && ready < count;) ::sched_yield();
}

std::vector<char> pattern(std::size_t size) {
  std::vector<char> bytes(size);
  for (std::size_t at = 0; at < size; ++at) bytes[at] = static_cast<char>('a' + at % 23 + at / 4096 % 3);
  return bytes;
}

// Two pages, of which the second is not there.
char* half_page() {
  const long page = ::sysconf(_SC_PAGESIZE);
  char* const pages = static_cast<char*>(::mmap(nullptr, static_cast<std::size_t>(2 * page),
                                                PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
  ::munmap(pages + page, static_cast<std::size_t>(page));
  std::memset(pages, 'p', static_cast<std::size_t>(page));
  return pages + page;
}

void do_vectors() {
  char text[6] = "hello";
  const iovec parts[3] = {{text, 2}, {nullptr, 0}, {text + 2, 3}};
  char first[2] = {};
  char second[8] = {};
  const iovec into[2] = {{first, 2}, {second, 8}};
  const ssize_t got = ::readv(line, into, 2);
  say("readv", got,
      std::string(first, 2) + std::string(second, static_cast<std::size_t>(got > 2 ? got - 2 : 0)));
  say("writev", ::writev(line, parts, 3));
  const std::vector<iovec> many(1025, iovec{text, 1});
  say("many", ::writev(line, many.data(), 1025));
  say("most", ::writev(line, many.data(), 1024));
  const iovec negative{text, static_cast<std::size_t>(-1)};
  say("negative", ::writev(line, &negative, 1));
  say("none", ::writev(line, parts, 0));
}

void do_bad() {
  auto* const nowhere = reinterpret_cast<char*>(no_address);
  say("bad write", ::write(line, nowhere, 4));
  say("bad vector", ::writev(line, reinterpret_cast<iovec*>(nowhere), 1));
  char* const end = half_page();
  say("half", ::write(line, end - 2048, 4096));
  say("last", ::write(line, end - 3, 3));
}

// Another thread looks at the line's flags all the while.
void do_flags() {
  bool over = false;
  int seen = 0;
  std::thread looks([&] {
    while (!__atomic_load_n(&over, __ATOMIC_ACQUIRE)) {
      if ((::fcntl(line, F_GETFL) & O_NONBLOCK) != 0) ++seen;
    }
  });
  for (int i = 0; i < 2000; ++i) {
    char back = 0;
    if (::write(line, "=", 1) != 1 || ::read(line, &back, 1) != 1) break;
  }
  __atomic_store_n(&over, true, __ATOMIC_RELEASE);
  looks.join();
  say("flags", seen);
}

void do_copy(const std::string& how) {
  const int before = line;
  if (how == "dup") line = ::dup(before);
  if (how == "dup2") line = ::dup2(before, 0);
  if (how == "dup0") {  // the lowest that is free, as shells do
    ::close(0);
    line = ::dup(before);
  }
  if (how == "dup20") line = ::dup2(before, 20);
  if (how == "dupfd") line = ::fcntl(before, F_DUPFD_CLOEXEC, 10);
  ::close(before);
  const bool lowest = how == "dup0" || how == "dup2";
  say(how, line < 0 ? -1 : 0, lowest ? line == 0 ? "at 0" : "elsewhere" : "");
}

// One thread opens and closes the line, another one makes files where the lowest numbers are free: none of
// these may become something else.
void do_race(int opens) {
  ::close(0);
  bool over = false;
  std::thread opener([&] {
    for (int n = 0; n < opens; ++n) {
      const int fd = ::open(path, O_RDWR | O_NOCTTY);
      if (fd >= 0) ::close(fd);
    }
    __atomic_store_n(&over, true, __ATOMIC_RELEASE);
  });
  int replaced = 0;
  while (!__atomic_load_n(&over, __ATOMIC_ACQUIRE)) {
    const int fd = ::eventfd(0, 0);
    for (int look = 0; look < 20; ++look) {
      struct stat status {};
      if (::fstat(fd, &status) == 0 && S_ISCHR(status.st_mode)) {
        ++replaced;
        break;
      }
    }
    ::close(fd);
  }
  opener.join();
  say("race", replaced);
}

// All below 1000 are taken.
void do_fill() {
  while (::dup(2) < 999) {
  }
}

// The child has it alone in the end.
void do_fork() {
  const pid_t child = ::fork();
  if (child != 0) {
    ::close(line);
    int status = 0;
    ::waitpid(child, &status, 0);
    say("child", WEXITSTATUS(status));
    return;
  }
  ::usleep(1);
  if (::write(line, "child", 5) != 5) ::_exit(1);
  ::_exit(0);
}

// As a shell does it: what was there is put back, and is not the line.
void do_redirect() {
  int pipe_ends[2];
  if (::pipe(pipe_ends) != 0) return;
  ::dup2(line, 1);
  const ssize_t to_line = ::write(1, "to line", 7);
  ::dup2(pipe_ends[1], 1);
  const ssize_t to_pipe = ::write(1, "to pipe", 7);
  ::close(pipe_ends[1]);
  ::close(1);
  char back[32] = {};
  const ssize_t got = ::read(pipe_ends[0], back, sizeof(back));
  say("redirect", got,
      std::string(back, static_cast<std::size_t>(got > 0 ? got : 0)) +
          (to_line == 7 && to_pipe == 7 ? "" : " short"));
}

// Two threads read, and the main one leaves each signal to them.
void do_threads() {
  sigset_t alarms;
  ::sigemptyset(&alarms);
  ::sigaddset(&alarms, SIGALRM);
  int interrupted[2] = {};
  int strange = 0;
  set_alarm(3, false);
  std::thread readers[2];
  for (int which = 0; which < 2; ++which) {
    readers[which] = std::thread([&, which] {
      ::pthread_sigmask(SIG_UNBLOCK, &alarms, nullptr);
      for (int i = 0; i < 20; ++i) {
        char byte = 0;
        if (::read(line, &byte, 1) >= 0 || errno != EINTR) __atomic_add_fetch(&strange, 1, __ATOMIC_RELAXED);
        ++interrupted[which];
      }
    });
    ::pthread_sigmask(SIG_BLOCK, &alarms, nullptr);
  }
  for (std::thread& reader : readers) reader.join();
  say("threads", strange);
}

// A process whose first thread has ended before the others.
void do_first_ends() {
  const pid_t child = ::fork();
  if (child == 0) {
    set_alarm(20, false);
    std::thread([] {
      char byte = 0;
      ::_exit(::read(line, &byte, 1) < 0 && errno == EINTR ? 3 : 4);
    }).detach();
    ::pthread_exit(nullptr);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  say("first ends", WIFEXITED(status) ? WEXITSTATUS(status) : -1);
}

// A thread waits in read(), and the process is told to stop.
void do_stop() {
  const pid_t child = ::fork();
  if (child == 0) {
    std::thread reads([] {
      char byte = 0;
      (void)!::read(line, &byte, 1);
    });
    for (;;) ::pause();
  }
  ::usleep(20'000);  // that it is in the read cannot be seen; else it stops at once
  int status = 0;
  ::kill(child, SIGSTOP);
  ::waitpid(child, &status, WUNTRACED);
  say("stop", WIFSTOPPED(status));
  ::kill(child, SIGKILL);
  ::waitpid(child, &status, 0);
}

// The descriptor is closed while a thread reads from it.
void do_close_under_read() {
  std::string bytes(9, '\0');
  ssize_t got = 0;
  const int fd = line;
  std::thread reads([&] { got = ::read(fd, bytes.data(), bytes.size()); });
  ::usleep(20'000);  // that it is in the read cannot be seen
  if (::write(line, "give |late", 10) != 10) std::abort();
  ::close(line);
  reads.join();
  bytes.resize(static_cast<std::size_t>(got > 0 ? got : 0));
  say("close under read", got, bytes);
}

// While one thread's write waits, another's neither comes between nor, where it is not to wait, at all.
void do_two_writes() {
  const std::vector<char> bytes(60'000, 'a');
  bool begun = false;
  std::thread writes([&] {
    __atomic_store_n(&begun, true, __ATOMIC_RELEASE);
    if (::write(line, bytes.data(), bytes.size()) != static_cast<ssize_t>(bytes.size())) std::abort();
  });
  while (!__atomic_load_n(&begun, __ATOMIC_ACQUIRE)) ::sched_yield();
  const std::vector<char> others(5'000, 'b');
  if (::write(line, others.data(), others.size()) != static_cast<ssize_t>(others.size())) std::abort();
  writes.join();
  say("two writes", 0);
}

// So many threads read a byte each; a signal interrupts one of them, and the others get theirs.
void do_crowd(int size) {
  set_alarm(0, false);
  porttape::test::Crowd crowd(size, [] {
    char byte = 0;
    return ::read(line, &byte, 1);
  });
  const pthread_t one = crowd.thread(size / 2);
  const std::string end = crowd.ended_by([one] { ::pthread_kill(one, SIGALRM); });
  const std::string bytes = "give " + std::string(static_cast<std::size_t>(size) - 1, 'x');
  if (::write(line, bytes.data(), bytes.size()) != static_cast<ssize_t>(bytes.size())) std::abort();
  crowd.await_ones(size - 1);
  say("crowd " + end, size - 1);
}

// All of `/` again, mounted where nobody else has it.
bool enter_other_root() {
  constexpr unsigned kClone = 1U | 0x8000U | O_CLOEXEC;  // OPEN_TREE_CLONE, AT_RECURSIVE
  const auto root = static_cast<int>(::syscall(SYS_open_tree, AT_FDCWD, "/", kClone));
  const bool entered = root >= 0 && ::fchdir(root) == 0 && ::chroot(".") == 0;
  if (root >= 0) ::close(root);
  return entered;
}

// From then on it reads and writes no files but those that it has.
bool restrict_by_landlock() {
  const std::uint64_t handled = 2U | 4U;  // LANDLOCK_ACCESS_FS_WRITE_FILE, _READ_FILE
  const auto rules = static_cast<int>(::syscall(444, &handled, sizeof(handled), 0));
  const bool restricted =
      rules >= 0 && ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && ::syscall(446, rules, 0) == 0;
  if (rules >= 0) ::close(rules);
  return restricted;
}

void do_give_up(const std::string& how) {
  const bool done = how == "users"  ? ::unshare(CLONE_NEWUSER) == 0
                    : how == "root" ? enter_other_root()
                                    : restrict_by_landlock();
  std::fprintf(out, "%s\n", done ? "given up" : "cannot");
  std::fflush(out);
}

// From its folder on, by a name of PATH_MAX - 1 characters.
int open_by_long_name(const std::string& begin) {
  const std::string whole = path;
  const std::size_t slash = whole.rfind('/');
  const std::string folder = whole.substr(0, slash);
  if (::chdir(folder.c_str()) != 0) std::abort();
  const std::string round = "../" + folder.substr(folder.rfind('/') + 1) + "/";
  const std::string end = whole.substr(slash + 1);
  std::string name = begin;
  while (name.size() + round.size() + end.size() < PATH_MAX) name += round;
  name.append(PATH_MAX - 1 - name.size() - end.size(), '/');
  return ::open((name + end).c_str(), O_RDWR | O_NOCTTY);
}

// "chain": by a link from the folder to a link that is in another one.
int open_by_link(const std::string& how, const std::string& target) {
  const std::string link = results + ".link";
  ::unlink(link.c_str());
  if (::symlink(target.c_str(), link.c_str()) != 0) std::abort();
  const std::size_t slash = link.rfind('/');
  std::string name = link;
  if (how != "link") {
    if (::chdir(link.substr(0, slash).c_str()) != 0) std::abort();
    name = link.substr(slash + 1);
  }
  if (how == "chain") {
    const std::string folder = name + ".folder";
    ::mkdir(folder.c_str(), 0700);
    ::unlink((folder + "/next").c_str());
    if (::symlink(("../" + name).c_str(), (folder + "/next").c_str()) != 0) std::abort();
    name = folder + "/next";
  }
  return ::open(name.c_str(), O_RDWR | O_NOCTTY);
}

// In ways that name the line otherwise, or that the kernel refuses.
void do_open_as(const std::string& how) {
  open_how wanted{};
  wanted.flags = O_RDWR | O_NOCTTY;
  std::size_t size = sizeof(wanted);
  if (how == "new") {
    line = ::open(path, O_RDWR | O_NOCTTY | O_CREAT | O_EXCL, 0600);
  } else if (how == "slashes") {
    line = ::open(("//" + std::string(path).insert(1, "./")).c_str(), O_RDWR | O_NOCTTY);
  } else if (how == "long" || how == "longown") {
    line = open_by_long_name(how == "long" ? "" : "/proc/self/cwd/");
  } else if (how == "number" || how.ends_with("link") || how == "chain") {
    const int before = ::open(path, O_RDWR | O_NOCTTY);
    const std::string own = "self/fd/" + std::to_string(before);
    if (how == "number") {
      if (::chdir("/proc") != 0) std::abort();
      line = ::open(own.c_str(), O_RDWR | O_NOCTTY);
    } else {
      line = open_by_link(how, "/proc/" + own);
    }
    ::close(before);
  } else {
    if (how == "small") size = 16;
    if (how == "mode") wanted.mode = 0600;
    if (how == "unknown") wanted.flags |= 1ULL << 40U;
    line = static_cast<int>(::syscall(SYS_openat2, AT_FDCWD, path, &wanted, size));
  }
  say(how, line < 0 ? -1 : 0);
}

int open_in_spite_of_signals(const char* name) {
  int fd = -1;
  do {
    fd = ::open(name, O_RDWR | O_NOCTTY);
  } while (fd < 0 && errno == EINTR);
  return fd;
}

// Closes the line and the lowest descriptor again and again, while signals come whose handler does not
// restart calls. Says how many closes failed.
void do_closes(int count) {
  int failed = 0;
  struct sigaction action {};
  action.sa_handler = on_alarm;
  ::sigaction(SIGALRM, &action, nullptr);
  const itimerval timer = {{0, 200}, {0, 200}};
  ::setitimer(ITIMER_REAL, &timer, nullptr);
  ::close(0);
  for (int at = 0; at < count; ++at) {
    const int lowest = open_in_spite_of_signals("/dev/null");
    if (::close(lowest) != 0) ++failed;
    if (at % 8 != 0) continue;
    line = open_in_spite_of_signals(path);
    if (::close(line) != 0) ++failed;
  }
  const itimerval none{};
  ::setitimer(ITIMER_REAL, &none, nullptr);
  say("closes", failed);
}

// A line of its own hangs up with its last close. Says how often it had not, by who else had it.
void do_last_closes(int count) {
  const int master = ::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
  if (master < 0 || ::grantpt(master) != 0 || ::unlockpt(master) != 0) std::abort();
  const std::string name = ::ptsname(master);
  int late = 0;
  for (int at = 0; at < count; ++at) {
    line = ::open(name.c_str(), O_RDWR | O_NOCTTY);
    if (at % 3 == 0) (void)!::write(line, "x", 1);
    if (at % 3 == 1) ::tcdrain(line);
    if (at % 3 == 2) {
      char byte = 0;
      set_reads(1, 0, false);
      std::thread gives([&] { (void)!::write(master, "y", 1); });
      (void)!::read(line, &byte, 1);
      gives.join();
    }
    ::close(line);
    pollfd hung_up{master, POLLIN, 0};
    if (::poll(&hung_up, 1, 0) < 0 || (hung_up.revents & POLLHUP) == 0) ++late;
  }
  say("last closes", late);
}

// By what a thread can do without read() and write().
void do_aio() {
  aio_context_t context = 0;
  if (::syscall(SYS_io_setup, 1, &context) != 0) std::abort();
  char text[] = "aio";
  iocb request{};
  request.aio_lio_opcode = IOCB_CMD_PWRITE;
  request.aio_fildes = static_cast<unsigned>(line);
  request.aio_buf = reinterpret_cast<std::uint64_t>(text);
  request.aio_nbytes = 3;
  iocb* requests[] = {&request};
  say("aio", ::syscall(SYS_io_submit, context, 1, requests));
  request.aio_fildes = static_cast<unsigned>(::fileno(out));
  request.aio_nbytes = 0;
  say("aio elsewhere", ::syscall(SYS_io_submit, context, 1, requests));
  ::syscall(SYS_io_destroy, context);
}

bool do_line_step(const std::string& name, const std::string& value) {
  if (name == "open") {
    open_line(0);
    say("open", line < 0 ? -1 : 0);
  } else if (name == "giveup") {
    do_give_up(value);
  } else if (name == "open0") {
    ::close(0);
    open_line(0);
    say("open0", line);
  } else if (name == "become") {
    do_become();
  } else if (name == "became") {
    // The lowest of those that a tap gives.
    ::dprintf(::fcntl(::fileno(out), F_DUPFD, 960), "became\n");
  } else if (name == "few") {
    const rlimit limit{64, 64};
    ::setrlimit(RLIMIT_NOFILE, &limit);
  } else if (name == "raw") {
    const std::size_t colon = value.find(':');
    set_reads(std::atoi(value.c_str()), std::atoi(value.c_str() + colon + 1), false);
  } else if (name == "lines") {
    set_reads(1, 0, true);
  } else if (name == "nonblock") {
    ::fcntl(line, F_SETFL, O_NONBLOCK);
    say("nonblock", ::fcntl(line, F_GETFL) & O_NONBLOCK ? 1 : 0);
  } else if (name == "fionbio") {
    int on = std::atoi(value.c_str());
    const int made = ::ioctl(line, FIONBIO, &on);
    say("fionbio", made < 0 ? made : (::fcntl(line, F_GETFL) & O_NONBLOCK) != 0);
  } else if (name == "close") {
    say("close", ::close(line));
  } else if (name == "closes") {
    do_closes(std::atoi(value.c_str()));
  } else if (name == "lastcloses") {
    do_last_closes(std::atoi(value.c_str()));
  } else if (name == "copy") {
    do_copy(value);
  } else if (name == "race") {
    do_race(std::atoi(value.c_str()));
  } else if (name == "fill") {
    do_fill();
  } else if (name == "number") {
    say("number", line);
  } else if (name == "fork") {
    do_fork();
  } else if (name == "openas") {
    do_open_as(value);
  } else if (name == "creat") {
    line = ::creat(path, 0600);
    say("creat", line < 0 ? -1 : 0);
  } else if (name == "reopen") {
    ::dup2(line, 0);
    ::close(line);
    line = ::open("/dev/stdin", O_RDWR | O_NOCTTY);
    ::close(0);
    say("reopen", line < 0 ? -1 : 0);
  } else {
    return false;
  }
  return true;
}

// `now:7E`, `drain:8N` or `flush:8O`: when it is made, data bits and parity.
void set_frame(const std::string& value) {
  const int when = value.starts_with("now") ? TCSANOW : value.starts_with("drain") ? TCSADRAIN : TCSAFLUSH;
  const std::string frame = value.substr(value.find(':') + 1);
  termios made{};
  ::tcgetattr(line, &made);
  ::cfsetspeed(&made, frame.front() == '7' ? B9600 : B19200);
  made.c_cflag &= ~static_cast<tcflag_t>(CSIZE | PARENB | PARODD);
  made.c_cflag |= frame.front() == '7' ? CS7 : CS8;
  if (frame.back() != 'N') made.c_cflag |= PARENB;
  if (frame.back() == 'O') made.c_cflag |= PARODD;
  (void)::tcsetattr(line, when, &made);  // of a pty's frame the kernel makes less
  say("set", 0);
}

bool do_step(const std::string& name, const std::string& value) {
  if (do_line_step(name, value)) return true;
  if (name == "write") {
    say("write", ::write(line, value.data(), value.size()));
  } else if (name == "read") {
    read_some(std::strtoul(value.c_str(), nullptr, 10));
  } else if (name == "all") {
    read_all(std::strtoul(value.c_str(), nullptr, 10));
  } else if (name == "big") {
    const std::vector<char> bytes = pattern(std::strtoul(value.c_str(), nullptr, 10));
    say("big", ::write(line, bytes.data(), bytes.size()));
  } else if (name == "bigv") {
    std::vector<char> bytes = pattern(std::strtoul(value.c_str(), nullptr, 10));
    const iovec parts[2] = {{bytes.data(), bytes.size() - 7}, {bytes.data() + bytes.size() - 7, 7}};
    say("bigv", ::writev(line, parts, 2));
  } else if (name == "redirect") {
    do_redirect();
  } else if (name == "threads") {
    do_threads();
  } else if (name == "firstends") {
    do_first_ends();
  } else if (name == "stop") {
    do_stop();
  } else if (name == "crowd") {
    do_crowd(std::atoi(value.c_str()));
  } else if (name == "closeunder") {
    do_close_under_read();
  } else if (name == "twowrites") {
    do_two_writes();
  } else if (name == "p2") {
    char bytes[9] = {};
    iovec part{const_cast<char*>(value.data()), value.size()};
    say("pwritev2", ::pwritev2(line, &part, 1, -1, 0));
    part = {bytes, 3};
    const ssize_t got = ::preadv2(line, &part, 1, -1, 0);
    say("preadv2", got, bytes);
  } else if (name == "dsync") {
    const iovec part{const_cast<char*>(value.data()), value.size()};
    say("dsync", ::pwritev2(line, &part, 1, -1, RWF_DSYNC));
  } else if (name == "aio") {
    do_aio();
  } else if (name == "getfd") {
    const auto own = static_cast<int>(::syscall(SYS_pidfd_open, ::getpid(), 0));
    line = static_cast<int>(::syscall(SYS_pidfd_getfd, own, line, 0));
    say("getfd", line < 0 ? -1 : 0);
  } else if (name == "readonly") {
    char* const end = half_page();
    ::mprotect(end - 4096, 4096, PROT_READ);
    say("readonly", ::read(line, end - 3, 3));
    say("untouched", end[-3] == 'p');
  } else if (name == "openserved") {
    do_open_served();
  } else if (name == "vectors") {
    do_vectors();
  } else if (name == "bad") {
    do_bad();
  } else if (name == "badread") {
    say("badread", ::read(line, reinterpret_cast<char*>(no_address), 4));
  } else if (name == "arrived") {
    await_bytes(std::atoi(value.c_str()));
  } else if (name == "alarm") {
    set_alarm(std::atoi(value.c_str()), value.ends_with("r"));
  } else if (name == "quiet") {
    const itimerval none{};
    ::setitimer(ITIMER_REAL, &none, nullptr);
  } else if (name == "flags") {
    do_flags();
  } else if (name == "flush") {
    say("flush", ::tcflush(line, std::atoi(value.c_str())));
  } else if (name == "drain") {
    say("drain", ::tcdrain(line));
  } else if (name == "tcsbrk") {
    say("tcsbrk", ::ioctl(line, TCSBRKP, 1));
  } else if (name == "longbreak") {
    say("longbreak", ::ioctl(line, TCSBRK, 0));
  } else if (name == "set") {
    set_frame(value);
  } else if (name == "mget") {
    int bits = -1;
    const int got = ::ioctl(line, TIOCMGET, &bits);
    say("mget", got < 0 ? got : bits);
  } else if (name == "mbis" || name == "mbic" || name == "mset") {
    int bits = (value.find("dtr") == std::string::npos ? 0 : TIOCM_DTR) |
               (value.find("rts") == std::string::npos ? 0 : TIOCM_RTS);
    const unsigned long request = name == "mbis" ? TIOCMBIS : name == "mbic" ? TIOCMBIC : TIOCMSET;
    say(name.c_str(), ::ioctl(line, request, &bits));
  } else if (name == "badlines") {
    say("badlines", ::ioctl(line, TIOCMBIS, reinterpret_cast<int*>(no_address)));
  } else if (name == "badset") {
    say("badset", ::ioctl(line, TCSETS, reinterpret_cast<int*>(no_address)));
  } else if (name == "sbrk") {
    say("sbrk", ::ioctl(line, TIOCSBRK));
    say("cbrk", ::ioctl(line, TIOCCBRK));
  } else {
    return false;
  }
  return true;
}

}  // namespace

// A `+` in front of the results' name: they are added to those of the program that this one was.
int main(int count, char** words) {
  path = words[1];
  const bool adds = *words[2] == '+';
  results = adds ? words[2] + 1 : words[2];
  out = std::fopen(results.c_str(), adds ? "ae" : "we");
  if (out == nullptr) return 9;
  for (int i = 3; i < count; ++i) {
    const std::string step = words[i];
    const std::size_t colon = std::min(step.find(':'), step.size());
    errno = 0;
    if (!do_step(step.substr(0, colon), step.substr(std::min(colon + 1, step.size())))) return 8;
  }
  return std::fclose(out) == 0 ? 0 : 7;
}
