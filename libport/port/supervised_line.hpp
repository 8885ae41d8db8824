#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include "libport/base/tty_device.hpp"
#include "libport/line/line_event.hpp"
#include "libport/line/line_request.hpp"
#include "libport/line/line_settings.hpp"
#include "libport/line/line_signal.hpp"

namespace porttape {

// Is told by a driver's port what its peer would find on a serial line; for one who answers the peer's calls.
// All calls come on the loop's thread.
class LineSupervisor {
 public:
  // A program has opened the line that nobody had open; the last one has closed it, or it was hung up.
  virtual void line_opened() = 0;
  virtual void line_closed() = 0;
  // The device's settings are so, also those that the line itself cannot show.
  virtual void line_shows(const LineSettings& settings) = 0;
  // The device has changed a signal: cts, dsr, cd, ri, or a break of its own.
  virtual void line_signalled(const LineSignal& signal) = 0;
  // The port is being destroyed: it may not be called any more.
  virtual void line_gone() = 0;

 protected:
  ~LineSupervisor() = default;
};

// The side of a driver's port for one who sees each of its peer's calls before the kernel does them, and so
// knows what no look at the line shows. A port without it (a socket) needs none. Loop thread only.
class SupervisedLine {
 public:
  // From now on the settings of the line are told by peer_did() alone. Null: by looks again.
  virtual void supervise(LineSupervisor* supervisor) = 0;
  // The descriptor that stands for the line, as long as supervise() holds: through it settings are read and
  // made. -1: there is none just now.
  [[nodiscard]] virtual int line_fd() const = 0;
  // The tty by which the peer's descriptors are known; nothing: there is no line just now.
  [[nodiscard]] virtual std::optional<TtyDevice> line_device() const = 0;
  // Passes on what the peer has written so far, and learns of opens and closes so far. False: some of it has
  // to wait, since the device takes nothing yet.
  virtual bool catch_up() = 0;
  // Bytes of the peer that were passed on so far, in all.
  [[nodiscard]] virtual std::uint64_t passed_on() const = 0;
  // The peer has done this to its line, behind all that was caught up with: a flush that the kernel has done;
  // settings; a signal: dtr, rts, break, or where neither device nor tape has signals, what it is shown of
  // cts, dsr, cd, ri. Not for requests.
  virtual void peer_did(const LineEvent& event) = 0;
  // The peer waits until all that it has written has left the device: `done` is called then, or when the line
  // is over; once, from within or later.
  virtual void wait_until_sent(std::function<void()> done) = 0;
  // The peer asks the device, behind all that it has done before: `done` is called once, from within or
  // later.
  virtual void ask(const LineRequest& request, TakeAnswer done) = 0;

 protected:
  ~SupervisedLine() = default;
};

}  // namespace porttape
