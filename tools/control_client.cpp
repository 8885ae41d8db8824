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
#include "libport/base/peer_process.hpp"
#include "libport/base/whole_number.hpp"
#include "tools/command_line.hpp"
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
  const std::optional<ucred> peer = peer_process(fd);
  return peer && peer->pid == socket.pid && (peer->uid == socket.owner || peer->uid == 0);
}

// Of the one who serves there, whatever he says. 0 is one whom our namespace does not see.
pid_t pid_of_daemon(int fd, const ControlSocket& socket) {
  const std::optional<ucred> peer = peer_process(fd);
  return peer && peer->pid > 0 ? peer->pid : socket.pid;
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

enum class Connected : std::uint8_t {
  yes,
  no,    // no daemon has the socket any more
  later  // others wait there already, longer than the descriptor waits
};

Result<Connected> connect_to(int fd, const ControlSocket& socket) {
  const auto address = socket_address(socket.path);
  if (!address) return failed(socket.pid, ENAMETOOLONG);
  if (::connect(fd, reinterpret_cast<const sockaddr*>(&*address), sizeof *address) != 0) {
    const int error = errno;
    if (error == ENOENT) return Connected::no;
    if (error == EAGAIN) return Connected::later;
    if (error != ECONNREFUSED || !is_stale_socket(socket.path)) return failed(socket.pid, error);
    remove_stale(socket.path);
    return Connected::no;
  }
  if (is_of_its_daemon(fd, socket)) return Connected::yes;
  return make_error(Errc::usage, fmt::format("{}: it is not process {} that serves it; it is not asked",
                                             socket.path, socket.pid));
}

Result<json::object> reply_of(pid_t pid, const std::string& line) {
  json::error_code wrong;
  const json::value value = json::parse(line, wrong);
  if (wrong || !value.is_object())
    return make_error(Errc::io,
                      fmt::format("process {} answers something else than a daemon of porttape", pid));
  const json::object& reply = value.get_object();
  const json::value* ok = reply.if_contains("ok");
  if (ok != nullptr && ok->is_bool() && ok->get_bool()) return reply;
  return make_error(text_of(reply, "kind") == "usage" ? Errc::usage : Errc::io, text_of(reply, "error"));
}

std::optional<pid_t> parse_pid(const std::string& text) {
  const auto pid = whole_number<pid_t>(text);
  return pid && *pid > 0 ? pid : std::nullopt;
}

}  // namespace

ControlClient::ControlClient(UniqueFd fd, ControlSocket socket)
    : fd_(std::move(fd)),
      process_(static_cast<int>(::syscall(SYS_pidfd_open, socket.pid, 0))),
      socket_(std::move(socket)) {}

Result<std::optional<ControlClient>> ControlClient::connect(const ControlSocket& socket) {
  UniqueFd fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (!fd) return failed(socket.pid, errno);
  set_limit(fd.get(), kLimit);
  const Result<Connected> connected = connect_to(fd.get(), socket);
  if (!connected) return connected.error();
  if (*connected == Connected::later) return failed(socket.pid, EAGAIN);
  return *connected == Connected::yes ? std::optional(ControlClient(std::move(fd), socket)) : std::nullopt;
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
  return reply_of(pid(), *answer);
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

// Asks daemons for their status, all at the same time.
class DaemonSearch {
 public:
  explicit DaemonSearch(const std::vector<ControlSocket>& sockets) {
    for (const ControlSocket& socket : sockets) asked_.push_back({socket, {}, {}, false});
  }
  RunningDaemons run();

 private:
  // A daemon that is asked, and the part of its answer that has arrived.
  struct Asked {
    ControlSocket socket;
    UniqueFd fd;  // unset until it is connected
    std::string input;
    bool over = false;
  };

  void connect(Asked& asked);
  void read(Asked& asked);
  void answered(Asked& asked, std::string line);
  void give_up(Asked& asked, Error error);
  void wait(Nanos left);

  std::vector<Asked> asked_;
  RunningDaemons found_;
};

RunningDaemons DaemonSearch::run() {
  const Instant limit = verb_clock().now() + ControlClient::kLimit;
  for (;;) {
    for (Asked& asked : asked_) {
      if (!asked.over && !asked.fd) connect(asked);
      if (!asked.over && asked.fd) read(asked);
    }
    std::erase_if(asked_, [](const Asked& asked) { return asked.over; });
    const Nanos left = limit - verb_clock().now();
    if (asked_.empty() || left <= Nanos::zero()) break;
    wait(left);
  }
  for (Asked& asked : asked_) give_up(asked, failed(asked.socket.pid, EAGAIN));
  std::ranges::sort(found_.daemons, {}, [](const RunningDaemon& each) { return each.client.pid(); });
  return std::move(found_);
}

void DaemonSearch::connect(Asked& asked) {
  UniqueFd fd(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (!fd) return give_up(asked, failed(asked.socket.pid, errno));
  const Result<Connected> connected = connect_to(fd.get(), asked.socket);
  if (!connected) return give_up(asked, connected.error());
  asked.over = *connected == Connected::no;
  if (*connected != Connected::yes) return;
  const std::string request = json::serialize(json::object{{"verb", "status"}}) + '\n';
  const ssize_t sent = ::send(fd.get(), request.data(), request.size(), MSG_NOSIGNAL);
  if (sent < 0) return give_up(asked, failed(asked.socket.pid, errno));
  asked.fd = std::move(fd);  // a new socket's buffer holds the whole request
}

void DaemonSearch::read(Asked& asked) {
  std::array<char, 65536> buffer;
  for (;;) {
    const ssize_t size = ::recv(asked.fd.get(), buffer.data(), buffer.size(), 0);
    if (size < 0 && errno == EINTR) continue;
    if (size < 0 && errno == EAGAIN) return;
    if (size < 0) return give_up(asked, failed(asked.socket.pid, errno));
    if (size == 0)
      return give_up(asked, make_error(Errc::io, fmt::format("process {} has ended", asked.socket.pid)));
    asked.input.append(buffer.data(), static_cast<std::size_t>(size));
    if (const std::size_t newline = asked.input.find('\n'); newline != std::string::npos)
      return answered(asked, asked.input.substr(0, newline));
    if (asked.input.size() > kMostReply) return give_up(asked, failed(asked.socket.pid, EMSGSIZE));
  }
}

void DaemonSearch::answered(Asked& asked, std::string line) {
  const Result<json::object> reply = reply_of(asked.socket.pid, line);
  if (!reply) return give_up(asked, reply.error());
  const int flags = ::fcntl(asked.fd.get(), F_GETFL);
  if (flags < 0 || ::fcntl(asked.fd.get(), F_SETFL, flags & ~O_NONBLOCK) != 0)
    return give_up(asked, failed(asked.socket.pid, errno));
  json::object status = object_of(*reply, "status");
  status["pid"] = pid_of_daemon(asked.fd.get(), asked.socket);
  found_.daemons.push_back({ControlClient(std::move(asked.fd), asked.socket), std::move(status)});
  asked.over = true;
}

void DaemonSearch::give_up(Asked& asked, Error error) {
  found_.silent.push_back(std::move(error));
  asked.over = true;
}

// Waits for answers. poll() cannot wait for a place in a full backlog: while a daemon is not connected the
// wait is short, and run() tries again.
void DaemonSearch::wait(Nanos left) {
  constexpr Nanos kConnectAgain = std::chrono::milliseconds(10);
  std::vector<pollfd> watched;
  for (const Asked& asked : asked_) {
    if (asked.fd) watched.push_back({asked.fd.get(), POLLIN, 0});
  }
  const bool all = watched.size() == asked_.size();
  const auto ms = std::chrono::ceil<std::chrono::milliseconds>(all ? left : std::min(left, kConnectAgain));
  (void)::poll(watched.data(), watched.size(), static_cast<int>(ms.count()));
}

RunningDaemons find_daemons(const WantedDaemons& wanted) {
  std::vector<ControlSocket> sockets = control_sockets(ControlEnvironment::of_process(), wanted.others);
  if (wanted.pid) std::erase_if(sockets, [&](const ControlSocket& each) { return each.pid != *wanted.pid; });
  return DaemonSearch(sockets).run();
}

std::string no_daemon_text(const WantedDaemons& wanted) {
  const std::string what =
      wanted.pid ? fmt::format("process {} is no porttaped", *wanted.pid) : "no porttaped runs";
  if (::geteuid() != 0) return what + "; root sees those of all users, with --user all";
  if (wanted.others.all) return what;
  return what + "; those of other users are seen with --user NAME, or --user all";
}

void WantedDaemons::add_options(CommandLine& line) {
  line.value("pid,p", "PID", "that daemon alone")
      .value("user", "NAME|all", "those of that user too, or of all (as root)");
}

Result<WantedDaemons> WantedDaemons::of(const CommandLine& line) {
  WantedDaemons wanted;
  if (const auto given = line.text("pid")) {
    wanted.pid = parse_pid(*given);
    if (!wanted.pid)
      return make_error(Errc::usage, "--pid is '" + *given + "'; it must be the number of a process");
  }
  if (const auto given = line.text("user")) {
    const Result<OtherUsers> others = OtherUsers::parse(*given);
    if (!others) return make_error(Errc::usage, "--user: " + others.error().message);
    if (::geteuid() != 0 && others->one != ::geteuid())
      return make_error(Errc::usage, "--user: root alone may ask other users' daemons; add sudo");
    wanted.others = *others;
  }
  return wanted;
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
