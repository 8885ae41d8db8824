#include "tools/child_process.hpp"

#include <cerrno>
#include <filesystem>
#include <fmt/format.h>
#include <memory>
#include <signal.h>
#include <spawn.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <system_error>
#include <unistd.h>
#include <utility>

#include "libport/base/printable.hpp"

namespace porttape {
namespace {

std::vector<char*> pointers(const std::vector<std::string>& texts) {
  std::vector<char*> all;
  all.reserve(texts.size() + 1);
  for (const std::string& text : texts) all.push_back(const_cast<char*>(text.c_str()));
  all.push_back(nullptr);
  return all;
}

int spawn(const std::vector<std::string>& command, const ChildProcess::Environment& changed,
          ChildProcess::Output output, pid_t& pid) {
  const std::vector<char*> arguments = pointers(command);
  const std::vector<std::string> environment = ChildProcess::environment_with(changed);
  posix_spawnattr_t attributes;
  ::posix_spawnattr_init(&attributes);
  sigset_t defaults;
  ::sigemptyset(&defaults);
  for (const int number : ChildProcess::default_signals()) ::sigaddset(&defaults, number);
  ::posix_spawnattr_setsigdefault(&attributes, &defaults);
  ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF);
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  if (output == ChildProcess::Output::all_to_stderr)
    ::posix_spawn_file_actions_adddup2(&actions, STDERR_FILENO, STDOUT_FILENO);
  const int error = ::posix_spawnp(&pid, arguments.front(), &actions, &attributes, arguments.data(),
                                   pointers(environment).data());
  ::posix_spawn_file_actions_destroy(&actions);
  ::posix_spawnattr_destroy(&attributes);
  return error;
}

// What to type instead, for a program that cannot be run.
std::string advice(const std::string& program, int error) {
  std::error_code unknown;
  const bool is_here = std::filesystem::is_regular_file(program, unknown);
  const bool named_by_path = program.find('/') != std::string::npos;
  if (error == EACCES && is_here) return "; chmod +x makes it executable, or put its interpreter before it";
  if (error == ENOEXEC && is_here) return "; it needs a first line such as #!/bin/sh";
  if (error != ENOENT) return {};
  if (is_here && named_by_path) return "; its first line names an interpreter that is not there";
  if (is_here) return fmt::format("; it is in this folder: ./{}", program);
  if (program.find(' ') != std::string::npos)
    return "; write program and arguments without quotes around all";
  return {};
}

}  // namespace

std::vector<std::string> ChildProcess::environment_with(const Environment& changed) {
  std::vector<std::string> all;
  for (char** entry = environ; *entry != nullptr; ++entry) {
    const std::string text = *entry;
    if (!changed.contains(text.substr(0, text.find('=')))) all.push_back(text);
  }
  for (const auto& [name, value] : changed) {
    if (value) all.push_back(fmt::format("{}={}", name, *value));
  }
  return all;
}

const std::vector<int>& ChildProcess::default_signals() {
  static const std::vector<int> signals{SIGPIPE, SIGXFSZ};
  return signals;
}

Error ChildProcess::cannot_run(const std::string& program, int error) {
  return make_error(Errc::usage, fmt::format("command {} cannot be run: {}{}", in_quotes(program),
                                             errno_text(error), advice(program, error)));
}

Result<std::unique_ptr<ChildProcess>> ChildProcess::start(Loop& loop, const std::vector<std::string>& command,
                                                          const Environment& changed, Output output,
                                                          std::function<void()> on_exit) {
  pid_t pid = 0;
  if (const int error = spawn(command, changed, output, pid); error != 0)
    return cannot_run(command.front(), error);
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
  end_ = WIFSIGNALED(status) ? CommandEnd{.signal = WTERMSIG(status)}
                             : CommandEnd{.status = WEXITSTATUS(status)};
}

void ChildProcess::kill(int signal_number) const {
  if (running()) ::kill(pid_, signal_number);
}

bool ChildProcess::in_our_group() const { return running() && ::getpgid(pid_) == ::getpgrp(); }

}  // namespace porttape
