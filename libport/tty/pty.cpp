#include "libport/tty/pty.hpp"

#include <array>
#include <cerrno>
#include <fcntl.h>
#include <fmt/format.h>
#include <grp.h>
#include <poll.h>
#include <pwd.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"
#include "libport/tty/tty.hpp"

namespace porttape {
namespace {

Error pty_error(std::string_view what) {
  return make_error(Errc::io, fmt::format("pty: {}: {}", what, errno_text(errno)));
}

Result<uid_t> user_id(const std::string& name) {
  if (name.empty()) return static_cast<uid_t>(-1);
  if (const auto id = whole_number<uid_t>(name)) return *id;
  if (const passwd* entry = ::getpwnam(name.c_str())) return entry->pw_uid;
  return make_error(Errc::usage, fmt::format("option 'owner': there is no user {}", in_quotes(name)));
}

Result<gid_t> group_id(const std::string& name) {
  if (name.empty()) return static_cast<gid_t>(-1);
  if (const auto id = whole_number<gid_t>(name)) return *id;
  if (const group* entry = ::getgrnam(name.c_str())) return entry->gr_gid;
  return make_error(Errc::usage, fmt::format("option 'group': there is no group {}", in_quotes(name)));
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
  int ready = 0;
  do {
    ready = ::poll(&state, 1, 0);
  } while (ready < 0 && errno == EINTR);
  return ready > 0 ? state.revents : short{0};
}

// The kernel hands what was written to the slave piece by piece; looking for it brings the next piece at
// once.
bool bring_in(int slave) {
  pollfd state{slave, POLLIN, 0};
  return ::poll(&state, 1, 0) > 0;
}

// The bytes that a program would find to read; nothing where the kernel does not tell.
std::optional<std::size_t> input_of(int slave) {
  int bytes = 0;
  bring_in(slave);
  if (::ioctl(slave, FIONREAD, &bytes) != 0) return std::nullopt;
  return static_cast<std::size_t>(bytes);
}

bool edits_lines(int slave) {
  termios tio{};
  return ::tcgetattr(slave, &tio) == 0 && (tio.c_lflag & static_cast<tcflag_t>(ICANON)) != 0;
}

void end_line_editing(int slave) {
  termios tio{};
  if (::tcgetattr(slave, &tio) != 0) return;
  tio.c_lflag &= ~static_cast<tcflag_t>(ICANON);
  (void)::tcsetattr(slave, TCSANOW, &tio);
}

// Reads all of it; nothing where the kernel does not tell, or may hide some of it in a line that has no end
// yet.
std::optional<std::size_t> read_input(int slave) {
  if (!input_of(slave)) return std::nullopt;
  std::array<char, 4096> buffer;
  std::size_t sum = 0;
  while (bring_in(slave)) {
    const ssize_t size = ::read(slave, buffer.data(), buffer.size());
    if (size <= 0) break;
    sum += static_cast<std::size_t>(size);
  }
  if (sum == 0 && edits_lines(slave)) return std::nullopt;
  return sum;
}

}  // namespace

Result<Pty> Pty::create(FileEvents& events, const Access& access) {
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
  pty.watch_ = events.watch_file(pty.slave_path_);
  if (!pty.exact()) pty.last_close_ = LastClose(pty.master());
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

bool Pty::occupied() const {
  const short state = poll_master(master());
  return (state & POLLHUP) == 0 || (state & POLLIN) != 0;
}

bool Pty::open_now() const { return (poll_master(master()) & POLLHUP) == 0; }

bool Pty::take_visit() {
  const bool now = last_close_.take();
  return std::exchange(visited_, false) || now;
}

void Pty::without_visit(const std::function<void()>& act) {
  visited_ = take_visit();
  act();
  (void)last_close_.take();
}

void Pty::unnoticed(const std::function<void()>& act) {
  without_visit([&] { watch_->unnoticed(act); });
}

Result<void> Pty::settle(const std::optional<LineSettings>& settings) {
  left_unread_.reset();
  // Our own open and flush are no news: not to inotify, not as a packet.
  Result<bool> next_is_there = false;
  watch_->unnoticed([&] {
    const Result<void> quiet = packet_mode(false);
    next_is_there = quiet ? freshen(settings) : quiet.error();
    if (const Result<void> packets = packet_mode(true); next_is_there && !packets)
      next_is_there = packets.error();
  });
  // Our own close, or that of the last driver, told late. The next driver has closed only if it was there.
  visited_ = last_close_.take() && next_is_there && *next_is_there;
  return next_is_there ? Result<void>() : next_is_there.error();
}

Result<bool> Pty::freshen(const std::optional<LineSettings>& settings) {
  const Result<TtyState> state = tty_state(master());
  if (!state) return state.error();
  const bool next_is_there = open_now();
  const Result<UniqueFd> slave = open_slave();
  if (!slave) return slave.error();
  (void)::ioctl(slave->get(), TIOCNXCL);
  if (!next_is_there) {
    if (Result<void> fresh = make_pty_fresh(master(), *state, settings); !fresh) return fresh.error();
  }
  // Out of ICANON, all of it is seen. What a next driver has read of it by now was read.
  left_unread_ = read_input(slave->get());
  if (::tcflush(slave->get(), TCIFLUSH) != 0) return pty_error("flushing " + slave_path_);
  return next_is_there;
}

bool Pty::has_input() const {
  int bytes = 0;
  // Looking for them brings in what the kernel has not handed over yet.
  return (poll_master(master()) & POLLIN) != 0 && ::ioctl(master(), FIONREAD, &bytes) == 0 && bytes > 0;
}

void Pty::drop_backlog(bool more) {
  constexpr int kFull = 4095;
  unnoticed([&] {
    const UniqueFd slave(::open(slave_path_.c_str(), O_RDONLY | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
    int bytes = 0;
    if (!slave) return;
    bring_in(slave.get());
    if (!more && (::ioctl(slave.get(), FIONREAD, &bytes) != 0 || bytes < kFull)) return;
    if (!packet_mode(false)) return;  // our own flush is no news
    (void)::tcflush(slave.get(), TCIFLUSH);
    (void)packet_mode(true);
  });
}

std::optional<std::size_t> Pty::unread() {
  std::optional<std::size_t> unread;
  unnoticed([&] {
    const UniqueFd slave(::open(slave_path_.c_str(), O_RDONLY | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
    if (slave) unread = input_of(slave.get());
  });
  return unread;
}

std::optional<std::size_t> Pty::read_away(LineIs line) {
  std::optional<std::size_t> bytes;
  unnoticed([&] {
    const UniqueFd slave(::open(slave_path_.c_str(), O_RDONLY | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
    if (!slave) return;
    if (line == LineIs::over) end_line_editing(slave.get());
    bytes = read_input(slave.get());
  });
  return bytes;
}

}  // namespace porttape
