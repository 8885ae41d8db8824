#include "libport/net/unix_port.hpp"

#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <optional>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

#include <spdlog/spdlog.h>

#include "libport/base/own_name.hpp"
#include "libport/base/printable.hpp"

namespace porttape {
namespace {

UniqueFd make_socket(int type = SOCK_STREAM) {
  return UniqueFd(::socket(AF_UNIX, type | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
}

Error cannot_make(const std::string& path, int error) {
  std::error_code unknown;
  const std::string folder = std::filesystem::absolute(path, unknown).parent_path().string();
  return make_error(Errc::usage,
                    fmt::format("socket {} cannot be made: {}{}", in_quotes(path), errno_text(error),
                                error == ENOENT ? "; type mkdir -p " + shell_word(folder) : ""));
}

}  // namespace

UnixPort::UnixPort(const PortContext& context, const CommonOptions& common, UnixOptions options)
    : StreamPort(context, common, options.stream), path_(std::move(options.path)), mode_(options.mode) {}

UnixPort::UnixPort(const PortContext& context, const CommonOptions& common, UnixOptions options,
                   UniqueFd given)
    : StreamPort(context, common, {}, std::move(given)),
      path_(std::move(options.path)),
      mode_(options.mode) {}

std::unique_ptr<StreamPort> UnixPort::port_of(UniqueFd connection) {
  UnixOptions options;
  options.path = path_;
  return std::make_unique<UnixPort>(context_, common_of_connections(), std::move(options),
                                    std::move(connection));
}

UnixPort::~UnixPort() {
  // Opens nothing: there may be no descriptor left.
  if (node_) (void)remove_if_same(place_.folder.get(), place_.name, *node_);
}

Result<void> UnixPort::free_place(const SocketAddress& address) const {
  const std::optional<FileIdentity> old = FileIdentity::at(place_.folder.get(), place_.name);
  struct stat status {};
  if (!old || ::fstatat(place_.folder.get(), place_.name.c_str(), &status, AT_SYMLINK_NOFOLLOW) != 0)
    return {};
  if (!S_ISSOCK(status.st_mode)) {
    return make_error(
        Errc::usage,
        fmt::format("socket {} exists and is not a socket; it is left alone, choose another path",
                    in_quotes(path_)));
  }
  // Of another type, so that whoever listens there sees no connection: EPROTOTYPE.
  const UniqueFd probe = make_socket(SOCK_DGRAM);
  if (!probe) return cannot_make(path_, errno);
  if (::connect(probe.get(), address.get(), address.size) == 0 || errno != ECONNREFUSED) {
    return make_error(Errc::usage, fmt::format("socket {} is in use; end that program or choose another path",
                                               in_quotes(path_)));
  }
  (void)remove_if_same(place_.folder.get(), place_.name, *old);
  return {};
}

Result<UniqueFd> UnixPort::make_listener() {
  const Result<SocketAddress> address = unix_address(path_);
  if (!address) return address.error();
  std::error_code unknown;
  const std::filesystem::path folder = std::filesystem::absolute(path_, unknown).parent_path();
  if (!std::filesystem::exists(folder, unknown)) return cannot_make(path_, ENOENT);
  Result<TrustedName> place = find_trusted_name(path_);
  if (!place) return place.error();
  place_ = std::move(*place);
  if (Result<void> free = free_place(*address); !free) return free.error();
  UniqueFd fd = make_socket();
  // The file's permissions are the socket's less the umask: never wider than `mode`, from the start.
  if (!fd || ::fchmod(fd.get(), mode_) != 0 || ::bind(fd.get(), address->get(), address->size) != 0)
    return cannot_make(path_, errno);
  // At once: who finds the file may connect.
  const int error = ::listen(fd.get(), StreamListener::kBacklog) == 0 ? 0 : errno;
  if (Result<void> own = own_node(); !own) return own.error();
  if (error != 0) return cannot_make(path_, error);
  context_.log->info("listening on {}", path_);
  return fd;
}

// Takes note of the socket file that bind() made, and gives it what the umask took from its permissions. What
// the name means may have changed since: only a socket of our own is touched, and no link is followed.
Result<void> UnixPort::own_node() {
  const UniqueFd node(::openat(place_.folder.get(), place_.name.c_str(), O_PATH | O_NOFOLLOW | O_CLOEXEC));
  struct stat status {};
  // What cannot be looked at is left where it is; the next listener finds that nobody answers there.
  if ((!node && errno != ENOENT && errno != ELOOP) || (node && ::fstat(node.get(), &status) != 0))
    return cannot_make(path_, errno);
  if (!S_ISSOCK(status.st_mode) || status.st_uid != ::geteuid()) {  // nothing there: all zeros
    return make_error(Errc::usage, fmt::format("socket {} was replaced as it was made; choose a folder "
                                               "that nobody else writes to",
                                               in_quotes(path_)));
  }
  node_ = FileIdentity::of(node.get());
  const std::string self = fmt::format("/proc/self/fd/{}", node.get());
  if ((status.st_mode & 0777) != mode_ && ::chmod(self.c_str(), mode_) != 0) {
    context_.log->warn("socket {} has the permissions {:04o}, not {:04o}: {}", in_quotes(path_),
                       status.st_mode & 0777, mode_, errno_text(errno));
  }
  return {};
}

Result<void> UnixPort::check_peer() {
  struct stat status {};
  const bool there = ::stat(path_.c_str(), &status) == 0;
  const int error = errno;
  if (there && S_ISSOCK(status.st_mode)) return {};
  return make_error(Errc::device_missing,
                    fmt::format("socket {}: {}", in_quotes(path_),
                                there ? "it is not a socket"
                                      : errno_text(error) + "; is the program that listens there running?"));
}

void UnixPort::connect_to_peer(Connector& connector) {
  const Result<SocketAddress> address = unix_address(path_);
  connector.to_address(*address);  // its length was checked with the options
}

PeerState UnixPort::peer_state(int fd) const {
  pollfd poll{fd, 0, 0};
  return ::poll(&poll, 1, 0) > 0 && (poll.revents & POLLHUP) != 0 ? PeerState::gone : PeerState::reading;
}

}  // namespace porttape
