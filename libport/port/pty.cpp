#include "libport/port/pty.hpp"

#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <grp.h>
#include <poll.h>
#include <pwd.h>
#include <stdlib.h>
#include <sys/inotify.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include "libport/port/tty.hpp"

namespace porttape {
namespace {

Error pty_error(std::string_view what) {
  return make_error(Errc::io, fmt::format("pty: {}: {}", what, errno_text(errno)));
}

template <class Id>
bool parse_id(const std::string& text, Id& id) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), id);
  return error == std::errc{} && end == text.data() + text.size();
}

Result<uid_t> user_id(const std::string& name) {
  uid_t id = static_cast<uid_t>(-1);
  if (name.empty() || parse_id(name, id)) return id;
  if (const passwd* entry = ::getpwnam(name.c_str())) return entry->pw_uid;
  return make_error(Errc::usage, fmt::format("option 'owner': there is no user '{}'", name));
}

Result<gid_t> group_id(const std::string& name) {
  gid_t id = static_cast<gid_t>(-1);
  if (name.empty() || parse_id(name, id)) return id;
  if (const group* entry = ::getgrnam(name.c_str())) return entry->gr_gid;
  return make_error(Errc::usage, fmt::format("option 'group': there is no group '{}'", name));
}

Result<void> give_access(const std::string& path, const Pty::Access& access) {
  const Result<uid_t> owner = user_id(access.owner);
  if (!owner) return owner.error();
  const Result<gid_t> group = group_id(access.group);
  if (!group) return group.error();
  if (::chown(path.c_str(), *owner, *group) != 0) return pty_error("giving " + path + " its owner");
  if (::chmod(path.c_str(), access.mode) != 0) return pty_error("giving " + path + " its mode");
  return {};
}

short poll_master(int fd) {
  pollfd state{fd, POLLIN, 0};
  return ::poll(&state, 1, 0) > 0 ? state.revents : short{0};
}

}  // namespace

Result<Pty> Pty::create(const Access& access) {
  Pty pty;
  pty.master_.reset(::posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  if (!pty.master_) return pty_error("no pty to be had");
  std::array<char, 64> path{};
  if (::grantpt(pty.master()) != 0 || ::unlockpt(pty.master()) != 0 ||
      ::ptsname_r(pty.master(), path.data(), path.size()) != 0) {
    return pty_error("unlocking it");
  }
  pty.slave_path_ = path.data();
  if (Result<void> raw = make_pty_raw(pty.master()); !raw) return raw.error();
  if (Result<void> packets = pty.packet_mode(true); !packets) return packets.error();
  if (Result<void> given = give_access(pty.slave_path_, access); !given) return given.error();
  if (Result<UniqueFd> slave = pty.open_slave(); !slave) return slave.error();
  pty.wake_.reset(::inotify_init1(IN_NONBLOCK | IN_CLOEXEC));
  if (!pty.wake_) return pty_error("inotify");
  if (Result<void> watched = pty.watch(); !watched) return watched.error();
  return pty;
}

Result<void> Pty::packet_mode(bool on) {
  const int value = on ? 1 : 0;
  if (::ioctl(master(), TIOCPKT, &value) != 0) return pty_error("packet mode");
  return {};
}

Result<UniqueFd> Pty::open_slave() const {
  UniqueFd slave(::open(slave_path_.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  if (!slave) return pty_error("opening " + slave_path_);
  return slave;
}

Result<void> Pty::watch() {
  watch_ = ::inotify_add_watch(wake_.get(), slave_path_.c_str(), IN_OPEN | IN_CLOSE);
  if (watch_ < 0) return pty_error("watching " + slave_path_);
  return {};
}

void Pty::unwatch() { ::inotify_rm_watch(wake_.get(), watch_); }

bool Pty::occupied() const {
  const short state = poll_master(master());
  return (state & POLLHUP) == 0 || (state & POLLIN) != 0;
}

bool Pty::open_now() const { return (poll_master(master()) & POLLHUP) == 0; }

std::vector<Pty::Event> Pty::take_events() {
  std::vector<Event> events;
  alignas(inotify_event) std::array<char, 4096> buffer;
  ssize_t size = 0;
  while ((size = ::read(wake_.get(), buffer.data(), buffer.size())) > 0) {
    for (std::size_t at = 0; at < static_cast<std::size_t>(size);) {
      inotify_event event{};
      std::memcpy(&event, buffer.data() + at, sizeof event);
      if ((event.mask & IN_OPEN) != 0) events.push_back(Event::opened);
      if ((event.mask & IN_CLOSE) != 0) events.push_back(Event::closed);
      at += sizeof event + event.len;
    }
    if (static_cast<std::size_t>(size) < buffer.size() / 2) break;  // no full buffer: nothing is left
  }
  return events;
}

Result<void> Pty::settle() {
  // Our own open and flush are no news: not to inotify, not as a packet.
  unwatch();
  (void)take_events();
  if (Result<void> plain = packet_mode(false); !plain) return plain;
  {
    const Result<UniqueFd> slave = open_slave();
    if (!slave) return slave.error();
    (void)::ioctl(slave->get(), TIOCNXCL);
    (void)::tcflush(slave->get(), TCIFLUSH);
    if (Result<void> raw = make_pty_raw(slave->get()); !raw) return raw;
  }
  if (Result<void> packets = packet_mode(true); !packets) return packets;
  return watch();
}

std::size_t Pty::unread() {
  unwatch();
  const std::size_t bytes = input_queue();
  (void)watch();
  return bytes;
}

std::size_t Pty::input_queue() const {
  const UniqueFd slave(::open(slave_path_.c_str(), O_RDONLY | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  int bytes = 0;
  if (!slave || ::ioctl(slave.get(), FIONREAD, &bytes) != 0) return 0;
  return static_cast<std::size_t>(bytes);
}

}  // namespace porttape
