#include "daemon/background.hpp"

#include <array>
#include <cerrno>
#include <fcntl.h>
#include <fmt/format.h>
#include <fstream>
#include <signal.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

namespace porttape {
namespace {

// The child's exit status, or 0 when it says that it is ready.
int wait_for_child(pid_t child, int from_child) {
  char ready = 0;
  ssize_t size = 0;
  do {
    size = ::read(from_child, &ready, 1);
  } while (size < 0 && errno == EINTR);
  if (size == 1) return 0;
  int status = 0;
  while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : exit_status::kRuntime;
}

bool alive(pid_t pid) { return pid > 0 && pid != ::getpid() && (::kill(pid, 0) == 0 || errno == EPERM); }

}  // namespace

Result<std::optional<int>> Background::start() {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0)
    return make_error(Errc::io, "going into the background: " + errno_text(errno));
  const UniqueFd from_child(ends[0]);
  UniqueFd to_parent(ends[1]);
  const pid_t child = ::fork();
  if (child < 0) return make_error(Errc::io, "going into the background: " + errno_text(errno));
  if (child > 0) {
    to_parent.reset();
    return std::optional<int>(wait_for_child(child, from_child.get()));
  }
  ::setsid();
  to_parent_ = std::move(to_parent);
  return std::optional<int>();
}

void Background::ready() {
  if (!to_parent_) return;
  const UniqueFd null(::open("/dev/null", O_RDWR | O_CLOEXEC));
  for (const int fd : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) (void)::dup2(null.get(), fd);
  (void)!::write(to_parent_.get(), "1", 1);
  to_parent_.reset();
}

Result<void> PidFile::write(const std::string& path) {
  pid_t old = 0;
  if (std::ifstream(path) >> old && alive(old)) {
    return make_error(
        Errc::usage,
        fmt::format("pidfile '{}' names process {}, which is running; end it or name another file", path,
                    old));
  }
  const UniqueFd fd(::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0644));
  const std::string text = fmt::format("{}\n", ::getpid());
  if (!fd || ::write(fd.get(), text.data(), text.size()) != static_cast<ssize_t>(text.size())) {
    return make_error(Errc::usage,
                      fmt::format("pidfile '{}' cannot be written: {}", path, errno_text(errno)));
  }
  path_ = path;
  return {};
}

PidFile::~PidFile() {
  if (!path_.empty()) (void)::unlink(path_.c_str());
}

}  // namespace porttape
