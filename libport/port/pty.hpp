#pragma once

#include <string>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/unique_fd.hpp"

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
  enum class Event { opened, closed };

  // A raw pty in packet mode with these permissions on the slave. `owner` and `group` may be names or
  // numbers, or empty.
  struct Access {
    unsigned mode = 0600;
    std::string owner;
    std::string group;
  };
  static Result<Pty> create(const Access& access);

  [[nodiscard]] int master() const { return master_.get(); }
  // Readable when a program has opened or closed the slave.
  [[nodiscard]] int wake_fd() const { return wake_.get(); }
  [[nodiscard]] const std::string& slave_path() const { return slave_path_; }

  // Whether a program has the slave open, or had and left bytes behind.
  [[nodiscard]] bool occupied() const;
  // Whether a program has the slave open now.
  [[nodiscard]] bool open_now() const;

  // The opens and closes since the last call, in order; empties wake_fd(). Equal ones in a row may be merged
  // by the kernel. An open is there before the first byte that is written after it.
  std::vector<Event> take_events();

  // Makes the line fresh for the next driver, as a real tty is: unread input gone, exclusive use given up,
  // raw. Call after the last close. Fails when a driver left TIOCEXCL set and we are not root: then only a
  // new pty helps.
  Result<void> settle();

  // Bytes written to the driver that it has not read yet; counts at most what the line discipline holds
  // (4095).
  [[nodiscard]] std::size_t unread();

 private:
  Pty() = default;
  Result<void> packet_mode(bool on);
  Result<UniqueFd> open_slave() const;
  Result<void> watch();
  void unwatch();
  [[nodiscard]] std::size_t input_queue() const;

  UniqueFd master_;
  UniqueFd wake_;  // inotify
  int watch_ = -1;
  std::string slave_path_;
};

}  // namespace porttape
