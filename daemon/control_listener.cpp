#include "daemon/control_listener.hpp"

#include <cerrno>
#include <fcntl.h>
#include <fmt/format.h>
#include <optional>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace porttape {
namespace {

constexpr int kBacklog = 16;

Error cannot(const std::string& path, const std::string& why) {
  return make_error(Errc::io, fmt::format("control socket '{}' cannot be made: {}", path, why));
}

// A folder that is there already must be one that nobody else can put anything into.
Result<void> check_folder(const ControlFolder& folder, int fd) {
  struct stat status {};
  if (::fstat(fd, &status) != 0) return cannot(folder.path, errno_text(errno));
  if (folder.given) return {};
  if (status.st_uid != ::geteuid()) return cannot(folder.path, "the folder is another user's");
  const unsigned others = 0777U & ~folder.mode;
  if ((status.st_mode & others & 077U) == 0) return {};
  return cannot(folder.path,
                fmt::format("others have access to the folder; chmod {:o} {}", folder.mode, folder.path));
}

Result<void> make_folder(const ControlFolder& folder) {
  const bool made = ::mkdir(folder.path.c_str(), folder.mode) == 0;
  if (!made && errno != EEXIST) return cannot(folder.path, errno_text(errno));
  const UniqueFd fd(
      ::open(folder.path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC | (folder.given ? 0 : O_NOFOLLOW)));
  if (!fd) return cannot(folder.path, errno == ELOOP ? "the folder is a link" : errno_text(errno));
  if (made) (void)::fchmod(fd.get(), folder.mode);  // whatever the umask took
  return check_folder(folder, fd.get());
}

}  // namespace

Result<ControlListener> ControlListener::create(const ControlFolder& folder) {
  if (Result<void> made = make_folder(folder); !made) return made.error();
  const std::string path = control_socket(folder.path, ::getpid());
  const auto address = socket_address(path);
  if (!address) return cannot(path, "the path is too long for a socket");
  const std::optional<FileIdentity> old = FileIdentity::at(AT_FDCWD, path);
  if (old && is_stale_socket(path)) (void)remove_if_same(AT_FDCWD, path, *old);
  UniqueFd fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  // The file's permissions are the socket's less the umask: never wider than these, from the start.
  if (!fd || ::fchmod(fd.get(), 0600) != 0 ||
      ::bind(fd.get(), reinterpret_cast<const sockaddr*>(&*address), sizeof *address) != 0)
    return cannot(path, errno_text(errno));
  ControlListener listener(std::move(fd), path);
  if (::listen(listener.fd(), kBacklog) != 0) return cannot(path, errno_text(errno));
  return listener;
}

ControlListener::ControlListener(UniqueFd fd, std::string path)
    : fd_(std::move(fd)), path_(std::move(path)), socket_(FileIdentity::at(AT_FDCWD, path_)) {}

// While the socket is open no other file can have its identity.
ControlListener::~ControlListener() {
  if (fd_ && socket_) (void)remove_if_same(AT_FDCWD, path_, *socket_);
}

}  // namespace porttape
