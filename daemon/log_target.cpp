#include "daemon/log_target.hpp"

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/net/socket_address.hpp"
#include "libport/taped/report_place.hpp"

namespace porttape {
namespace {

constexpr std::string_view kProgram = "porttaped";
constexpr unsigned kFacility = 3;  // daemon, of syslog(3)

// A link of another user's is not followed: it could lead to any file that we may write.
Result<UniqueFd> open_log(const std::string& path) {
  const Result<ReportPlace> place = find_report_place(path);
  if (!place)
    return make_error(Errc::usage,
                      fmt::format("option 'log-file': {}: {}", in_quotes(path), place.error().message));
  const int folder = place->folder.get();
  const char* const name = place->name.c_str();
  const int links = place->kind == ReportPlace::Kind::descriptor ? 0 : O_NOFOLLOW;
  const int flags = O_APPEND | O_CREAT | O_CLOEXEC | O_NOCTTY | O_NONBLOCK | links;
  UniqueFd fd(::openat(folder, name, O_WRONLY | flags, 0640));
  if (!fd && errno == ENXIO) fd.reset(::openat(folder, name, O_RDWR | flags, 0640));  // a FIFO nobody reads
  if (!fd)
    return make_error(Errc::usage,
                      fmt::format("option 'log-file': {} cannot be written: {}; name another file",
                                  in_quotes(path), errno_text(errno)));
  return fd;
}

bool wait_writable(int fd) {
  pollfd poll{fd, POLLOUT, 0};
  return ::poll(&poll, 1, -1) > 0 || errno == EINTR;
}

}  // namespace

Result<std::unique_ptr<LogTarget>> FileTarget::open(const std::string& path) {
  Result<UniqueFd> fd = open_log(path);
  if (!fd) return fd.error();
  return std::unique_ptr<LogTarget>(new FileTarget(std::move(*fd), path));
}

std::unique_ptr<LogTarget> FileTarget::stderr_target() {
  return std::unique_ptr<LogTarget>(new FileTarget(UniqueFd(::dup(STDERR_FILENO)), {}));
}

bool FileTarget::write(std::string_view lines) {
  while (!lines.empty()) {
    const ssize_t size = ::write(fd_.get(), lines.data(), lines.size());
    if (size > 0) {
      lines.remove_prefix(static_cast<std::size_t>(size));
    } else if (size < 0 && errno == EAGAIN) {
      if (!wait_writable(fd_.get())) return false;
    } else if (size == 0 || errno != EINTR) {
      return false;
    }
  }
  return true;
}

// One that cannot be opened leaves the old one in its place.
void FileTarget::reopen() {
  if (path_.empty()) return;
  if (Result<UniqueFd> fd = open_log(path_)) fd_ = std::move(*fd);
}

std::unique_ptr<LogTarget> SocketTarget::connect(const std::string& path, Protocol protocol) {
  std::unique_ptr<SocketTarget> target(new SocketTarget(path, protocol));
  if (!target->connect_again()) return nullptr;
  return target;
}

bool SocketTarget::connect_again() {
  const Result<SocketAddress> address = unix_address(path_);
  if (!address) return false;
  fd_.reset(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  return fd_ && ::connect(fd_.get(), address->get(), address->size) == 0;
}

bool SocketTarget::send(const std::string& message) {
  const auto sent = [&] {
    ssize_t size = 0;
    do {
      size = ::send(fd_.get(), message.data(), message.size(), MSG_NOSIGNAL);
    } while (size < 0 && errno == EINTR);
    return size >= 0;
  };
  return sent() || (connect_again() && sent());
}

bool SocketTarget::write(std::string_view lines) {
  bool all = true;
  while (!lines.empty()) {
    const std::size_t end = std::min(lines.find('\n'), lines.size());
    all = send(as_message(protocol_, lines.substr(0, end))) && all;
    lines.remove_prefix(std::min(end + 1, lines.size()));
  }
  return all;
}

std::string as_message(SocketTarget::Protocol protocol, std::string_view line) {
  unsigned priority = 6;
  if (line.size() > 2 && line[0] == '<' && line[2] == '>') {
    priority = static_cast<unsigned>(line[1] - '0');
    line.remove_prefix(3);
  }
  if (protocol == SocketTarget::Protocol::syslog)
    return fmt::format("<{}>{}[{}]: {}", kFacility * 8 + priority, kProgram, ::getpid(), line);
  return fmt::format("PRIORITY={}\nSYSLOG_IDENTIFIER={}\nMESSAGE={}\n", priority, kProgram, line);
}

}  // namespace porttape
