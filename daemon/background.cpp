#include "daemon/background.hpp"

#include <array>
#include <cerrno>
#include <fcntl.h>
#include <fmt/format.h>
#include <optional>
#include <string_view>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

#include "libport/base/own_name.hpp"
#include "libport/base/printable.hpp"

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

// Nothing, or a number and a newline.
bool is_pid_text(std::string_view text) {
  const std::size_t digits = text.find_first_not_of("0123456789");
  return text.empty() || (digits == text.size() - 1 && digits > 0 && text.back() == '\n') ||
         digits == std::string_view::npos;
}

// 0, or the errno.
int write_number(int fd) {
  const std::string number = fmt::format("{}\n", ::getpid());
  if (::ftruncate(fd, 0) != 0) return errno;
  for (std::size_t done = 0; done < number.size();) {
    const ssize_t part = ::pwrite(fd, number.data() + done, number.size() - done, static_cast<off_t>(done));
    if (part < 0 && errno == EINTR) continue;
    if (part <= 0) return part < 0 ? errno : ENOSPC;
    done += static_cast<std::size_t>(part);
  }
  return 0;
}

// Why its number could be another user's word, which is a number that an init script may kill; empty: it is
// not. One that has no name any more is its maker's, who ends.
std::string why_not_trusted(int fd) {
  struct stat status {};
  if (::fstat(fd, &status) != 0) return "cannot be looked at: " + errno_text(errno);
  if (!is_own_or_root(status.st_uid)) return "is another user's";
  if (status.st_nlink > 1) return "has other names too";
  if ((status.st_mode & (S_IWGRP | S_IWOTH)) != 0) return "can be written by other users";
  return {};
}

Error refuse_pid_file(const std::string& path, const std::string& why) {
  return make_error(Errc::usage, fmt::format("pidfile {} {}; name another file", in_quotes(path), why));
}

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
  constexpr int kTries = 100;  // one that ends takes its file away as we open it
  Result<bool> taken = false;
  for (int n = 0; n < kTries && taken && !*taken; ++n) taken = try_to_take(path);
  if (!taken) return taken.error();
  if (!*taken) return refuse_pid_file(path, "is made and removed all the time");
  return {};
}

// Whether it is ours; not, where the name means another file by now.
Result<bool> PidFile::try_to_take(const std::string& path) {
  Result<TrustedName> place = find_trusted_name(path);
  if (!place)
    return make_error(Errc::usage, fmt::format("pidfile {}: {}", in_quotes(path), place.error().message));
  const int folder = place->folder.get();
  const std::string& name = place->name;
  const auto open_it = [&](int how) {
    return UniqueFd(::openat(folder, name.c_str(), O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC | how, 0644));
  };
  UniqueFd fd = open_it(O_CREAT | O_EXCL);
  const bool made = static_cast<bool>(fd);
  if (!fd && errno == EEXIST) fd = open_it(O_CREAT);
  const std::optional<FileIdentity> file = fd ? FileIdentity::of(fd.get()) : std::nullopt;
  if (!file) return refuse_pid_file(path, "cannot be written: " + errno_text(errno));
  const auto give_up = [&](const std::string& why, int error) {
    if (made) (void)remove_if_same(folder, name, *file);
    return refuse_pid_file(path, why + errno_text(error));
  };
  if (const std::string why = made ? "" : why_not_trusted(fd.get()); !why.empty())
    return refuse_pid_file(path, why + " and is left alone");
  std::array<char, 64> old{};
  const ssize_t size = ::read(fd.get(), old.data(), old.size());
  const std::string_view text(old.data(), size > 0 ? static_cast<std::size_t>(size) : 0);
  if (size < 0) return give_up("cannot be read: ", errno);
  if (!is_pid_text(text)) return refuse_pid_file(path, "is not a pidfile and is left alone");
  // The lock goes with the process, however it ends, and numbers are used again: the number alone says
  // nothing. Whoever made the file, it is theirs who hold the lock.
  if (::flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK) return give_up("cannot be locked: ", errno);
    return refuse_pid_file(
        path, fmt::format("is that of process {}, which is running", text.substr(0, text.find('\n'))));
  }
  if (FileIdentity::at(folder, name) != file) return false;
  if (const int error = write_number(fd.get()); error != 0) return give_up("cannot be written: ", error);
  fd_ = std::move(fd);
  place_ = std::move(*place);
  return true;
}

PidFile::~PidFile() { (void)remove_if_same(place_.folder.get(), place_.name, fd_.get()); }

}  // namespace porttape
