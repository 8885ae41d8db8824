#include "libport/supervise/supervised_command.hpp"

#include <array>
#include <cerrno>
#include <poll.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

#include "libport/supervise/guard.hpp"

namespace porttape {
namespace {

using Stage = SupervisedCommand::Trouble::Stage;
using Kind = GuardMessage::Kind;

constexpr int kGuardEnds = 2000;  // ms; one that the kernel holds longer is left to itself

UniqueFd process_fd(pid_t process) {
  // glibc 2.36 declares pidfd_open() without extern "C".
  return UniqueFd(static_cast<int>(::syscall(SYS_pidfd_open, process, 0)));
}

void reap_guard(pid_t guard) {
  const UniqueFd ends = process_fd(guard);
  pollfd polled{.fd = ends.get(), .events = POLLIN, .revents = 0};
  if (ends && ::poll(&polled, 1, kGuardEnds) != 1) return;
  while (::waitpid(guard, nullptr, 0) < 0 && errno == EINTR) {
  }
}

}  // namespace

std::unique_ptr<SupervisedCommand> SupervisedCommand::start(Loop& loop, const Options& options,
                                                            OnExit on_exit, Trouble& trouble) {
  std::array<int, 2> pair{};
  if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair.data()) != 0) {
    trouble = {Stage::machinery, errno, "a socket for the guard"};
    return nullptr;
  }
  UniqueFd ours(pair[0]);
  UniqueFd guards(pair[1]);
  sigset_t everything;
  sigset_t mask;
  ::sigfillset(&everything);
  ::pthread_sigmask(SIG_SETMASK, &everything, &mask);
  const pid_t guard = ::fork();
  if (guard == 0) run_guard(std::move(guards), options, mask);
  const int error = errno;
  ::pthread_sigmask(SIG_SETMASK, &mask, nullptr);
  if (guard < 0) {
    trouble = {Stage::machinery, error, "a process for the guard"};
    return nullptr;
  }
  guards.reset();
  std::unique_ptr<SupervisedCommand> made(
      new SupervisedCommand(loop, guard, std::move(ours), std::move(on_exit)));
  return made->wait_for_start(trouble) ? std::move(made) : nullptr;
}

SupervisedCommand::SupervisedCommand(Loop& loop, pid_t guard, UniqueFd line, OnExit on_exit)
    : guard_(guard),
      line_(std::move(line)),
      on_exit_(std::move(on_exit)),
      loop_(&loop),
      watch_(loop, line_.get(), [this] { on_readable(); }) {}

SupervisedCommand::~SupervisedCommand() {
  watch_.stop();
  line_.reset();
  if (guard_ > 0) reap_guard(guard_);
  if (command_ > 0 && guard_ == 0) {
    kill(SIGKILL);
    while (::waitpid(command_, nullptr, 0) < 0 && errno == EINTR) {
    }
  }
}

bool SupervisedCommand::wait_for_start(Trouble& trouble) {
  for (;;) {
    const std::optional<GuardMessage> message = receive_message(line_.get(), listener_);
    if (!message) {
      trouble = {Stage::machinery, 0, "the guard of the command has ended"};
      return false;
    }
    switch (message->kind) {
      case Kind::trouble:
        trouble = {message->stage, message->number, message->text};
        return false;
      case Kind::started:
        if (listener_) break;
        trouble = {Stage::machinery, EMFILE, "a descriptor for the command's calls"};
        return false;
      case Kind::running:
        command_ = message->number;
        watch_.watch_readable(true);
        return true;
      case Kind::exited:
        break;
    }
  }
}

void SupervisedCommand::on_readable() {
  UniqueFd none;
  const std::optional<GuardMessage> message = receive_message(line_.get(), none);
  if (!message) return guard_gone();
  if (message->kind == Kind::exited) ended(message->number);
}

// Somebody has killed it; the command is our child now, if it falls to us (PR_SET_CHILD_SUBREAPER).
void SupervisedCommand::guard_gone() {
  watch_.watch_readable(false);
  reap_guard(std::exchange(guard_, 0));
  if (!running()) return;
  command_fd_ = process_fd(command_);
  if (!command_fd_) return ended(SIGKILL);
  command_watch_.emplace(*loop_, command_fd_.get(), [this] {
    command_watch_->watch_readable(false);
    int status =
        SIGKILL;  // the kernel's, with the guard; where it falls to another, that one gets the status
    while (::waitpid(command_, &status, 0) < 0 && errno == EINTR) {
    }
    ended(status);
  });
  command_watch_->watch_readable(true);
}

void SupervisedCommand::ended(int wait_status) {
  command_ = 0;
  on_exit_(wait_status);
}

void SupervisedCommand::kill(int signal_number) const {
  if (!running()) return;
  ::kill(command_, signal_number);
  if (guard_ > 0) ::kill(guard_, SIGCONT);  // which tells of the command's end; somebody may have stopped it
}

}  // namespace porttape
