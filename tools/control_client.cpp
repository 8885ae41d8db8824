#include "tools/control_client.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <poll.h>
#include <string_view>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <unistd.h>
#include <utility>

#include <boost/json/parse.hpp>
#include <boost/json/serialize.hpp>

#include "libport/base/own_name.hpp"
#include "libport/base/whole_number.hpp"
#include "tools/verb_clock.hpp"

namespace porttape {
namespace {

namespace json = boost::json;

constexpr std::size_t kMostReply = std::size_t{64} << 20;

Error failed(pid_t pid, int error) {
  if (error == EACCES || error == EPERM)
    return make_error(Errc::usage,
                      fmt::format("process {} is another user's; ask as that user or as root", pid));
  if (error == EAGAIN || error == EWOULDBLOCK)
    return make_error(Errc::io, fmt::format("process {} does not answer within {} s; is it stopped?", pid,
                                            ControlClient::kLimit.count()));
  return make_error(Errc::io, fmt::format("process {}: {}", pid, errno_text(error)));
}

void set_limit(int fd, Nanos limit) {
  const auto us = std::max<std::int64_t>(std::chrono::duration_cast<Micros>(limit).count(), 1);
  const timeval time{us / 1'000'000, us % 1'000'000};
  (void)::setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &time, sizeof time);
  (void)::setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &time, sizeof time);
}

// A folder that is not root's may be one of a user who wants us to take something else for a daemon.
bool is_of_its_daemon(int fd, const ControlSocket& socket) {
  if (socket.owner == 0) return true;
  ucred peer{};
  socklen_t size = sizeof peer;
  return ::getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0 && peer.pid == socket.pid &&
         (peer.uid == socket.owner || peer.uid == 0);
}

// In a folder of our user's alone, and in the one that was looked at. Another daemon may have taken the name
// since.
void remove_stale(const std::string& path) {
  const std::filesystem::path socket(path);
  const UniqueFd folder(::open(socket.parent_path().c_str(), O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  struct stat status {};
  if (!folder || ::fstat(folder.get(), &status) != 0 || status.st_uid != ::geteuid()) return;
  const std::optional<FileIdentity> old = FileIdentity::at(folder.get(), socket.filename());
  if (old && is_stale_socket(path)) (void)remove_if_same(folder.get(), socket.filename(), *old);
}

}  // namespace

ControlClient::ControlClient(UniqueFd fd, ControlSocket socket)
    : fd_(std::move(fd)),
      process_(static_cast<int>(::syscall(SYS_pidfd_open, socket.pid, 0))),
      socket_(std::move(socket)) {}

Result<std::optional<ControlClient>> ControlClient::connect(const ControlSocket& socket) {
  const auto address = socket_address(socket.path);
  UniqueFd fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (!fd || !address) return failed(socket.pid, address ? errno : ENAMETOOLONG);
  set_limit(fd.get(), kLimit);
  if (::connect(fd.get(), reinterpret_cast<const sockaddr*>(&*address), sizeof *address) != 0) {
    const int error = errno;
    if (error == ENOENT) return std::optional<ControlClient>();
    if (error != ECONNREFUSED || !is_stale_socket(socket.path)) return failed(socket.pid, error);
    remove_stale(socket.path);
    return std::optional<ControlClient>();
  }
  if (!is_of_its_daemon(fd.get(), socket))
    return make_error(Errc::usage, fmt::format("{}: it is not process {} that serves it; it is not asked",
                                               socket.path, socket.pid));
  return std::optional(ControlClient(std::move(fd), socket));
}

Result<json::object> ControlClient::ask(const json::object& request) {
  const std::string line = json::serialize(request) + '\n';
  for (std::size_t sent = 0; sent < line.size();) {
    const ssize_t part = ::send(fd_.get(), line.data() + sent, line.size() - sent, MSG_NOSIGNAL);
    if (part < 0 && errno == EINTR) continue;
    if (part < 0) return failed(pid(), errno);
    sent += static_cast<std::size_t>(part);
  }
  const Result<std::string> answer = read_line();
  if (!answer) return answer.error();
  json::error_code wrong;
  const json::value value = json::parse(*answer, wrong);
  if (wrong || !value.is_object())
    return make_error(Errc::io,
                      fmt::format("process {} answers something else than a daemon of porttape", pid()));
  const json::object& reply = value.get_object();
  const json::value* ok = reply.if_contains("ok");
  if (ok != nullptr && ok->is_bool() && ok->get_bool()) return reply;
  return make_error(text_of(reply, "kind") == "usage" ? Errc::usage : Errc::io, text_of(reply, "error"));
}

Result<std::string> ControlClient::read_line() {
  const Instant limit = verb_clock().now() + kLimit;
  for (;;) {
    if (const std::size_t newline = input_.find('\n'); newline != std::string::npos) {
      std::string line = input_.substr(0, newline);
      input_.erase(0, newline + 1);
      return line;
    }
    const Nanos left = limit - verb_clock().now();
    if (left <= Nanos::zero()) return failed(pid(), EAGAIN);
    set_limit(fd_.get(), left);
    std::array<char, 65536> buffer;
    const ssize_t size = ::recv(fd_.get(), buffer.data(), buffer.size(), 0);
    if (size < 0 && errno == EINTR) continue;
    if (size < 0) return failed(pid(), errno);
    if (size == 0) return make_error(Errc::io, fmt::format("process {} has ended", pid()));
    input_.append(buffer.data(), static_cast<std::size_t>(size));
    if (input_.size() > kMostReply) return failed(pid(), EMSGSIZE);
  }
}

bool ControlClient::wait_ended(Nanos limit) const {
  const Instant end = verb_clock().now() + limit;
  for (;;) {
    // Without a process to watch: the connection goes with it, after a late reply perhaps.
    pollfd watched = process_ ? pollfd{process_.get(), POLLIN, 0} : pollfd{fd_.get(), POLLRDHUP, 0};
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(end - verb_clock().now());
    const int ready = ::poll(&watched, 1, static_cast<int>(std::max<std::int64_t>(left.count(), 0)));
    if (ready > 0) return true;
    if (ready == 0 || errno != EINTR) return false;
  }
}

RunningDaemons find_daemons(std::optional<pid_t> pid) {
  RunningDaemons found;
  for (const ControlSocket& socket : control_sockets(ControlEnvironment::of_process())) {
    if (pid && socket.pid != *pid) continue;
    Result<std::optional<ControlClient>> client = ControlClient::connect(socket);
    if (client && !*client) continue;
    const Result<json::object> reply = client ? (*client)->ask({{"verb", "status"}}) : client.error();
    if (!reply) {
      found.silent.push_back(reply.error());
      continue;
    }
    found.daemons.push_back({std::move(**client), object_of(*reply, "status")});
  }
  return found;
}

std::optional<pid_t> parse_pid(const std::string& text) {
  const auto pid = whole_number<pid_t>(text);
  return pid && *pid > 0 ? pid : std::nullopt;
}

std::string text_of(const json::object& object, std::string_view key) {
  const json::value* value = object.if_contains({key.data(), key.size()});
  const json::string* text = value == nullptr ? nullptr : value->if_string();
  return text == nullptr ? std::string() : std::string(text->data(), text->size());
}

std::int64_t number_of(const json::object& object, std::string_view key) {
  const json::value* value = object.if_contains({key.data(), key.size()});
  const std::int64_t* number = value == nullptr ? nullptr : value->if_int64();
  return number == nullptr ? 0 : *number;
}

json::object object_of(const json::object& object, std::string_view key) {
  const json::value* value = object.if_contains({key.data(), key.size()});
  return value != nullptr && value->is_object() ? value->get_object() : json::object();
}

std::vector<json::object> objects_of(const json::object& object, std::string_view key) {
  std::vector<json::object> objects;
  const json::value* value = object.if_contains({key.data(), key.size()});
  const json::array* list = value == nullptr ? nullptr : value->if_array();
  if (list == nullptr) return objects;
  for (const json::value& each : *list) {
    if (each.is_object()) objects.push_back(each.get_object());
  }
  return objects;
}

}  // namespace porttape
