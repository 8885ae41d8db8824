#include "libport/supervise/guard.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <sstream>
#include <sys/prctl.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>
#include <vector>

namespace porttape {
namespace {

using Stage = SupervisedCommand::Trouble::Stage;
using Kind = GuardMessage::Kind;

struct MessageHead {
  GuardMessage::Kind kind;
  Stage stage;
  int number;
};

constexpr std::size_t kMostText = 2048;

std::vector<char*> pointers_to(const std::vector<std::string>& texts) {
  std::vector<char*> all;
  for (const std::string& text : texts) all.push_back(const_cast<char*>(text.c_str()));
  all.push_back(nullptr);
  return all;
}

[[noreturn]] void fail(int line, Stage stage, int error, std::string text = {}) {
  (void)send_message(line, {Kind::trouble, stage, error, std::move(text)});
  ::_exit(1);
}

// The signals that somebody handles here are handled no more after the exec, and must not be before.
void forget_handlers(const std::vector<int>& defaults) {
  for (int number = 1; number < NSIG; ++number) {
    struct sigaction action {};
    if (::sigaction(number, nullptr, &action) != 0) continue;
    const bool ours = std::ranges::find(defaults, number) != defaults.end();
    if (action.sa_handler != SIG_IGN || ours) ::signal(number, SIG_DFL);
  }
}

[[noreturn]] void run_command(const UniqueFd& line, const SupervisedCommand::Options& options,
                              const sigset_t& mask, pid_t guard) {
  // Who kills the guard, too, leaves nothing behind whose calls nobody answers.
  (void)::prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0);
  if (::getppid() != guard) ::_exit(1);
  forget_handlers(options.default_signals);
  if (options.output_to_stderr && ::dup2(STDERR_FILENO, STDOUT_FILENO) < 0)
    fail(line.get(), Stage::machinery, errno, "the command's stdout");
  const std::vector<char*> arguments = pointers_to(options.command);
  const std::vector<char*> environment = pointers_to(options.environment);
  Result<UniqueFd> listener = trap_calls(options.traps);
  if (!listener) fail(line.get(), Stage::trap, 0, listener.error().message);
  if (!send_message(line.get(), {Kind::started, {}, ::getpid(), {}}, listener->get())) ::_exit(1);
  listener->reset();
  ::sigprocmask(SIG_SETMASK, &mask, nullptr);
  ::execvpe(arguments.front(), arguments.data(), environment.data());
  fail(line.get(), Stage::exec, errno);
}

// All that has fallen to us and is below, once more and again until nothing is left: what is killed may just
// have forked.
void end_everything() {
  const std::string path = fmt::format("/proc/self/task/{}/children", ::getpid());
  for (;;) {
    int status = 0;
    while (::waitpid(-1, &status, WNOHANG) > 0) {
    }
    const UniqueFd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
    std::string text(65536, '\0');
    const ssize_t size = file ? ::read(file.get(), text.data(), text.size()) : -1;
    if (size <= 0 && ::waitpid(-1, &status, WNOHANG) < 0) return;  // no child left
    text.resize(static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
    std::istringstream children(text);
    for (pid_t child = 0; children >> child;) ::kill(child, SIGKILL);
    // What they started falls to us as they go. One that the kernel holds is waited for.
    (void)::waitpid(-1, &status, 0);
  }
}

// Until the parent is gone.
[[noreturn]] void watch_over(const UniqueFd& parent, const UniqueFd& child_ends, pid_t command) {
  for (;;) {
    std::array<pollfd, 2> polled{pollfd{.fd = parent.get(), .events = POLLIN, .revents = 0},
                                 pollfd{.fd = child_ends.get(), .events = POLLIN, .revents = 0}};
    (void)::poll(polled.data(), polled.size(), -1);
    signalfd_siginfo info{};
    while (::read(child_ends.get(), &info, sizeof(info)) > 0) {
    }
    int status = 0;
    for (pid_t child = 0; (child = ::waitpid(-1, &status, WNOHANG)) > 0;) {
      if (child == command) (void)send_message(parent.get(), {Kind::exited, {}, status, {}});
    }
    if (polled.front().revents == 0) continue;
    end_everything();
    ::_exit(0);
  }
}

}  // namespace

bool send_message(int line, const GuardMessage& message, int fd) {
  MessageHead head{message.kind, message.stage, message.number};
  const std::string text = message.text.substr(0, kMostText);
  std::array<iovec, 2> parts{iovec{&head, sizeof(head)}, iovec{const_cast<char*>(text.data()), text.size()}};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(int))> control{};
  msghdr all{};
  all.msg_iov = parts.data();
  all.msg_iovlen = parts.size();
  if (fd >= 0) {
    all.msg_control = control.data();
    all.msg_controllen = control.size();
    cmsghdr* const item = CMSG_FIRSTHDR(&all);
    item->cmsg_level = SOL_SOCKET;
    item->cmsg_type = SCM_RIGHTS;
    item->cmsg_len = CMSG_LEN(sizeof(int));
    std::memcpy(CMSG_DATA(item), &fd, sizeof(fd));
  }
  return ::sendmsg(line, &all, MSG_NOSIGNAL) >= 0;
}

std::optional<GuardMessage> receive_message(int line, UniqueFd& fd) {
  MessageHead head{};
  std::string text(kMostText, '\0');
  std::array<iovec, 2> parts{iovec{&head, sizeof(head)}, iovec{text.data(), text.size()}};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(int))> control{};
  msghdr all{};
  all.msg_iov = parts.data();
  all.msg_iovlen = parts.size();
  all.msg_control = control.data();
  all.msg_controllen = control.size();
  ssize_t size = 0;
  do {
    size = ::recvmsg(line, &all, MSG_CMSG_CLOEXEC);
  } while (size < 0 && errno == EINTR);
  for (cmsghdr* item = size > 0 ? CMSG_FIRSTHDR(&all) : nullptr; item != nullptr;
       item = CMSG_NXTHDR(&all, item)) {
    int got = -1;
    if (item->cmsg_type != SCM_RIGHTS) continue;
    std::memcpy(&got, CMSG_DATA(item), sizeof(got));
    fd.reset(got);
  }
  if (size < static_cast<ssize_t>(sizeof(head))) return std::nullopt;
  text.resize(static_cast<std::size_t>(size) - sizeof(head));
  return GuardMessage{head.kind, head.stage, head.number, std::move(text)};
}

// What the command tells goes through here, so that the listener stays open as long as the guard lives.
void run_guard(UniqueFd line, const SupervisedCommand::Options& options, const sigset_t& mask) {
  (void)::prctl(PR_SET_NAME, "porttape-guard");
  (void)::prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0);
  UniqueFd ours(line.get() > STDERR_FILENO ? line.release()
                                           : ::fcntl(line.get(), F_DUPFD_CLOEXEC, STDERR_FILENO + 1));
  if (!ours) ::_exit(1);
  std::array<int, 2> pair{};
  sigset_t child_ends;
  ::sigemptyset(&child_ends);
  ::sigaddset(&child_ends, SIGCHLD);
  const UniqueFd ends(::signalfd(-1, &child_ends, SFD_CLOEXEC | SFD_NONBLOCK));
  if (!ends || ::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair.data()) != 0)
    fail(ours.get(), Stage::machinery, errno, "a socket for the command");
  UniqueFd of_command(pair[0]);
  UniqueFd for_command(pair[1]);
  if (options.prepare) {
    if (Result<void> prepared = options.prepare(); !prepared)
      fail(ours.get(), Stage::prepare, 0, prepared.error().message);
  }
  const pid_t guard = ::getpid();
  const pid_t command = ::fork();
  if (command < 0) fail(ours.get(), Stage::machinery, errno, "a process for the command");
  if (command == 0) {
    ours.reset();
    of_command.reset();
    run_command(for_command, options, mask, guard);
  }
  for_command.reset();
  // The command has what it is to inherit. What is ours of the parent's (pty masters, locks, sockets), which
  // its exec closes, must not live on here.
  close_others(std::array{ours.get(), of_command.get(), ends.get()});
  UniqueFd listener;
  // It closes its end by the exec.
  while (const auto message = receive_message(of_command.get(), listener)) {
    if (message->kind == Kind::started && !listener) {
      ::kill(command, SIGKILL);
      fail(ours.get(), Stage::machinery, EMFILE, "a descriptor for the command's calls");
    }
    if (!send_message(ours.get(), *message, message->kind == Kind::started ? listener.get() : -1)) break;
  }
  (void)send_message(ours.get(), {Kind::running, {}, command, {}});
  watch_over(ours, ends, command);
}

}  // namespace porttape
