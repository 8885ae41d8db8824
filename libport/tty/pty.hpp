#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/line/line_settings.hpp"
#include "libport/loop/file_events.hpp"
#include "libport/tty/last_close.hpp"

namespace porttape {

// A pseudo-terminal pair of which we hold the master, with what is needed to learn when programs open and
// close the slave.
//
// The kernel tells of a last close by POLLHUP on the master and of an open not at all, so: the slave is
// opened and closed once at creation, which sets POLLHUP; from then on `occupied()` is the truth and inotify
// events on the slave are only the reason to look. No slave descriptor is held, since POLLHUP would never
// come.
class Pty {
 public:
  using Event = FileEvents::Event;

  // A raw pty in packet mode with these permissions on the slave. `owner` and `group` may be names or
  // numbers, or empty.
  struct Access {
    unsigned mode = 0600;
    std::string owner = {};
    std::string group = {};
  };
  static Result<Pty> create(FileEvents& events, const Access& access);

  [[nodiscard]] int master() const { return master_.get(); }
  // Called from the loop when a program has opened or closed the slave.
  void on_events(std::function<void()> callback) { watch_->on_event(std::move(callback)); }
  [[nodiscard]] const std::string& slave_path() const { return slave_path_; }

  // Whether a program has the slave open, or had and left bytes behind.
  [[nodiscard]] bool occupied() const;
  // Whether a program has the slave open now.
  [[nodiscard]] bool open_now() const;

  // The opens and closes since the last call, in order. An open is there before the first byte that is
  // written after it.
  std::vector<Event> take_events() { return watch_->take(); }
  // Whether each open and close is among them; else equal ones in a row may be one.
  [[nodiscard]] bool exact() const { return watch_->exact(); }
  // Whether programs have opened and closed it since the last call, or since settle(), and nobody has it open
  // now: for a pty whose events are not exact, or were lost.
  [[nodiscard]] bool take_visit();

  // Runs `act`, which changes the settings: that may look like such a visit, and is none.
  void without_visit(const std::function<void()>& act);

  // Makes the line fresh for the next driver, as a real tty is: unread input gone, exclusive use given up,
  // raw, with these settings (none: as they are). Where the next driver has it already, what that has set
  // stays. Call after the last close. Fails when a driver left TIOCEXCL set and we are not root, or when no
  // descriptor is to be had: what the last driver left is still there.
  Result<void> settle(const std::optional<LineSettings>& settings);

  // How much unread input that took away; nothing where that could not be seen.
  [[nodiscard]] std::optional<std::size_t> left_unread() const { return left_unread_; }

  // Whether the driver has written bytes that are not read here.
  [[nodiscard]] bool has_input() const;

  // For a driver that has flushed what came to it. TCSAFLUSH leaves what the line discipline had no room for:
  // that goes too, if there is as much (4095 bytes) or `more` was waiting here.
  void drop_backlog(bool more);

  // Bytes written to the driver that it has not read yet; counts at most what the line discipline holds
  // (4095), so that 0 alone is exact. Unknown when the slave cannot be looked at: the driver keeps it to
  // itself (TIOCEXCL) and we are not root, or no descriptor is to be had.
  [[nodiscard]] std::optional<std::size_t> unread();
  // Reads what the driver has not read, and returns how much it was; nothing where that cannot be seen. A
  // line that is over is taken out of ICANON for it, in which the kernel hides what no newline ends; one that
  // is the next driver's already stays as that has it.
  enum class LineIs : unsigned char { over, next_ones };
  [[nodiscard]] std::optional<std::size_t> read_away(LineIs line);

 private:
  Pty() = default;
  void unnoticed(const std::function<void()>& act);  // which opens and closes the slave
  Result<void> packet_mode(bool on);
  Result<UniqueFd> open_slave() const;
  // Returns whether the next driver has it open already.
  Result<bool> freshen(const std::optional<LineSettings>& settings);

  UniqueFd master_;
  std::string slave_path_;
  std::optional<std::size_t> left_unread_;
  std::unique_ptr<FileEvents::Watch> watch_;
  LastClose last_close_;
  bool visited_ = false;  // found by the way, and not taken yet
};

}  // namespace porttape
