#include "tools/child_process.hpp"

#include <cerrno>
#include <fmt/format.h>
#include <memory>
#include <signal.h>
#include <spawn.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

#include "libport/base/printable.hpp"

namespace porttape {
namespace {

// The command gets the signals as they were before we ignored some.
int spawn(const std::vector<std::string>& command, pid_t& pid) {
  std::vector<char*> arguments;
  arguments.reserve(command.size() + 1);
  for (const std::string& argument : command) arguments.push_back(const_cast<char*>(argument.c_str()));
  arguments.push_back(nullptr);
  posix_spawnattr_t attributes;
  ::posix_spawnattr_init(&attributes);
  sigset_t defaults;
  ::sigemptyset(&defaults);
  for (const int number : {SIGPIPE, SIGXFSZ}) ::sigaddset(&defaults, number);
  ::posix_spawnattr_setsigdefault(&attributes, &defaults);
  ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF);
  const int error = ::posix_spawnp(&pid, arguments.front(), nullptr, &attributes, arguments.data(), environ);
  ::posix_spawnattr_destroy(&attributes);
  return error;
}

}  // namespace

Result<std::unique_ptr<ChildProcess>> ChildProcess::start(Loop& loop, const std::vector<std::string>& command,
                                                          std::function<void()> on_exit) {
  pid_t pid = 0;
  if (const int error = spawn(command, pid); error != 0) {
    return make_error(Errc::usage, fmt::format("command {} cannot be run: {}", in_quotes(command.front()),
                                               errno_text(error)));
  }
  // glibc 2.36 declares pidfd_open() without extern "C".
  UniqueFd pid_fd(static_cast<int>(::syscall(SYS_pidfd_open, pid, 0)));
  if (!pid_fd) {
    const int error = errno;
    ::kill(pid, SIGKILL);
    ::waitpid(pid, nullptr, 0);
    return make_error(Errc::io, "watching the command: " + errno_text(error));
  }
  return std::unique_ptr<ChildProcess>(new ChildProcess(loop, pid, std::move(pid_fd), std::move(on_exit)));
}

ChildProcess::ChildProcess(Loop& loop, pid_t pid, UniqueFd pid_fd, std::function<void()> on_exit)
    : pid_(pid),
      pid_fd_(std::move(pid_fd)),
      on_exit_(std::move(on_exit)),
      watch_(loop, pid_fd_.get(), [this] {
        watch_.watch_readable(false);
        reap();
        on_exit_();
      }) {
  watch_.watch_readable(true);
}

ChildProcess::~ChildProcess() {
  if (!running()) return;
  kill(SIGKILL);
  reap();
}

void ChildProcess::reap() {
  int status = 0;
  while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
  }
  pid_ = 0;
  exit_code_ = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
}

void ChildProcess::kill(int signal_number) const {
  if (running()) ::kill(pid_, signal_number);
}

}  // namespace porttape
