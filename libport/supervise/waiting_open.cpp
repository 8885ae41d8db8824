#include "libport/supervise/waiting_open.hpp"

#include <array>
#include <cerrno>
#include <fcntl.h>
#include <optional>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

#include "libport/supervise/guard.hpp"

namespace porttape {
namespace {

// Keeps nothing of ours but its line and the file's folder; all signals are blocked.
[[noreturn]] void open_for(pid_t parent, int line, const ProgramFile& wanted, int flags) {
  (void)::prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0);
  if (::getppid() != parent) ::_exit(1);
  close_others(std::array{line, wanted.folder ? wanted.at() : line});
  const int file = ::openat(wanted.at(), wanted.path.c_str(),
                            (flags & ~(O_CREAT | O_EXCL | O_TRUNC)) | O_NOCTTY | O_CLOEXEC);
  const bool sent = send_message(line, {GuardMessage::Kind::started, {}, file < 0 ? errno : 0, {}}, file);
  ::_exit(sent ? 0 : 1);
}

}  // namespace

std::unique_ptr<WaitingOpen> WaitingOpen::start(Loop& loop, const ProgramFile& file, int flags, Done done) {
  std::array<int, 2> pair{};
  if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair.data()) != 0) return nullptr;
  UniqueFd ours(pair[0]);
  const UniqueFd others(pair[1]);
  sigset_t everything;
  sigset_t mask;
  ::sigfillset(&everything);
  const pid_t parent = ::getpid();
  ::pthread_sigmask(SIG_SETMASK, &everything, &mask);
  const pid_t process = ::fork();
  if (process == 0) open_for(parent, others.get(), file, flags);
  const int error = errno;
  ::pthread_sigmask(SIG_SETMASK, &mask, nullptr);
  errno = error;
  if (process < 0) return nullptr;
  return std::unique_ptr<WaitingOpen>(new WaitingOpen(loop, process, std::move(ours), std::move(done)));
}

WaitingOpen::WaitingOpen(Loop& loop, pid_t process, UniqueFd line, Done done)
    : process_(process),
      line_(std::move(line)),
      done_(std::move(done)),
      watch_(loop, line_.get(), [this] { on_readable(); }) {
  watch_.watch_readable(true);
}

WaitingOpen::~WaitingOpen() {
  watch_.stop();
  ::kill(process_, SIGKILL);
  while (::waitpid(process_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

void WaitingOpen::on_readable() {
  if (over()) return;
  watch_.stop();  // its end would be told again and again
  UniqueFd file;
  const std::optional<GuardMessage> message = receive_message(line_.get(), file);
  const int error = !message ? EINTR : message->number;  // somebody has killed it: it is to be tried again
  const auto done = std::exchange(done_, {});
  if (file || error != 0) return done(std::move(file), error);
  done({}, EMFILE);  // it was sent, and there was no descriptor for it here
}

}  // namespace porttape
