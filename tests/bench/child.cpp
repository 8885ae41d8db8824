#include "tests/bench/child.hpp"

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <fcntl.h>
#include <fstream>
#include <iterator>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace porttape::bench {
namespace {

std::uint64_t status_field(const std::string& file, const std::string& key) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (line.rfind(key, 0) == 0) return std::stoull(line.substr(key.size() + 1));
  }
  return 0;
}

int exit_code(int status) { return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status); }

// In the child, before anything else.
void become_child(pid_t parent) {
  for (const int number : {SIGINT, SIGTERM, SIGALRM, SIGPIPE}) std::signal(number, SIG_DFL);
  ::prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (::getppid() != parent) ::_exit(1);
}

[[noreturn]] void exec(const std::vector<std::string>& argv, const std::string& output) {
  if (!output.empty()) {
    const int fd = ::open(output.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (fd >= 0) {
      ::dup2(fd, STDOUT_FILENO);
      ::dup2(fd, STDERR_FILENO);
    }
  }
  std::vector<char*> raw;
  for (const std::string& argument : argv) raw.push_back(const_cast<char*>(argument.c_str()));
  raw.push_back(nullptr);
  ::execvp(raw[0], raw.data());
  std::fprintf(stderr, "%s: %s\n", raw[0], std::system_category().message(errno).c_str());
  ::_exit(127);
}

// A sum over the threads of a process.
std::uint64_t thread_sum(pid_t pid, const std::string& key) {
  std::uint64_t sum = 0;
  std::error_code ignored;
  const std::filesystem::path tasks = "/proc/" + std::to_string(pid) + "/task";
  for (const auto& task : std::filesystem::directory_iterator(tasks, ignored)) {
    sum += status_field(task.path() / "status", key);
  }
  return sum;
}

}  // namespace

std::int64_t cpu_ns(pid_t pid) {
  clockid_t clock{};
  timespec used{};
  if (::clock_getcpuclockid(pid, &clock) != 0 || ::clock_gettime(clock, &used) != 0) {
    throw BenchError("no CPU clock of process " + std::to_string(pid));
  }
  return std::int64_t{used.tv_sec} * 1'000'000'000 + used.tv_nsec;
}

std::uint64_t wakeups(pid_t pid) { return thread_sum(pid, "voluntary_ctxt_switches:"); }
std::uint64_t context_switches(pid_t pid) {
  return wakeups(pid) + thread_sum(pid, "nonvoluntary_ctxt_switches:");
}

std::uint64_t peak_rss_kib(pid_t pid) {
  return status_field("/proc/" + std::to_string(pid) + "/status", "VmHWM:");
}

Child Child::fork(const std::function<void()>& body) {
  std::fflush(nullptr);
  const pid_t parent = ::getpid();
  const pid_t pid = ::fork();
  if (pid < 0) throw_errno("fork");
  if (pid > 0) return Child(pid);
  become_child(parent);
  try {
    body();
    std::fflush(nullptr);
    ::_exit(0);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "linebench: %s\n", error.what());
    ::_exit(1);
  }
}

std::string last_lines(const std::filesystem::path& output) {
  constexpr std::size_t kMost = 600;
  std::ifstream in(output);
  const std::string all((std::istreambuf_iterator<char>(in)), {});
  return all.size() > kMost ? all.substr(all.size() - kMost) : all;
}

void stop_daemon(Child& daemon, const std::filesystem::path& output) {
  const int status = daemon.stop();
  if (status != 0)
    throw BenchError("the daemon ended with " + std::to_string(status) + ": " + last_lines(output));
}

Child Child::run(const std::vector<std::string>& argv, const std::string& output) {
  std::fflush(nullptr);
  const pid_t parent = ::getpid();
  const pid_t pid = ::fork();
  if (pid < 0) throw_errno("fork");
  if (pid > 0) {
    ::setpgid(pid, pid);  // here too: whoever comes first
    return Child(pid, true);
  }
  ::setpgid(0, 0);  // a wrapper (strace, env) ends together with what it runs
  become_child(parent);
  exec(argv, output);
}

Child& Child::operator=(Child&& other) noexcept {
  if (this != &other) {
    stop();
    pid_ = std::exchange(other.pid_, -1);
    status_ = other.status_;
    group_ = other.group_;
  }
  return *this;
}

Child::~Child() { stop(); }

std::optional<int> Child::poll() {
  if (pid_ > 0 && !status_) {
    int status = 0;
    if (::waitpid(pid_, &status, WNOHANG) == pid_) status_ = exit_code(status);
  }
  return status_;
}

int Child::wait() {
  while (pid_ > 0 && !status_) {
    int status = 0;
    if (::waitpid(pid_, &status, 0) == pid_) {
      status_ = exit_code(status);
    } else if (errno == EINTR) {
      check_signals();
    } else {
      throw_errno("waitpid");
    }
  }
  return status_.value_or(0);
}

int Child::stop() {
  if (pid_ <= 0 || poll()) return status_.value_or(0);
  const pid_t target = group_ ? -pid_ : pid_;
  ::kill(target, SIGTERM);
  for (int i = 0; i < 1000 && !poll(); ++i) {
    const timespec pause{0, 5'000'000};
    ::nanosleep(&pause, nullptr);
  }
  if (!poll()) {
    ::kill(target, SIGKILL);
    int status = 0;
    while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
    }
    status_ = exit_code(status);
  }
  return *status_;
}

BusyCores::BusyCores(int count) {
  for (int i = 0; i < count; ++i) {
    children_.push_back(Child::fork([] {
      volatile bool forever = true;
      while (forever) {
      }
    }));
  }
}

void pin_to_cpu(int cpu) {
  if (cpu < 0) return;
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<std::size_t>(cpu), &set);
  if (::sched_setaffinity(0, sizeof set, &set) != 0) throw_errno("--cpu " + std::to_string(cpu));
}

}  // namespace porttape::bench
