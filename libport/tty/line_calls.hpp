#pragma once

#include <cstddef>
#include <memory>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/line/line_request.hpp"
#include "libport/line/line_signal.hpp"

namespace porttape {

// How often the device has changed each of its signals, as its driver counts them (TIOCGICOUNT); of ri some
// drivers count every change, others only where it goes off.
struct SignalCounts {
  int cts = 0;
  int dsr = 0;
  int cd = 0;
  int ri = 0;
  int breaks = 0;
};

// What is asked of an open tty about its signals and about what it has not sent. A test plays the device by
// it. Any thread; whatever a call may wait for is said.
class LineCalls {
 public:
  // The kernel's.
  static std::shared_ptr<LineCalls> of_system();

  virtual ~LineCalls() = default;

  // Drives dtr, rts or the break. 0, or the error number: ENOTTY or EINVAL where the tty has no such thing.
  // May wait for the device; a break that begins waits for what was written, however long.
  virtual int set(int fd, const LineSignal& signal) = 0;
  // Any request but LineRequest::Kind::last_break. 0, or the error number. May wait for the device.
  virtual int ask(int fd, const LineRequest& request, LineAnswer& answer) = 0;
  // Bytes that the kernel holds for the device.
  virtual std::size_t unsent(int fd) = 0;
  // Waits until what was written has left the device, as long as that gets on. False: it stood still for
  // `patience`.
  virtual bool wait_until_sent(int fd, Nanos patience) = 0;

  // TIOCM_CTS and others, or nothing where the tty has no modem lines, or is gone. May wait for the device.
  virtual std::optional<int> modem_lines(int fd) = 0;
  virtual std::optional<SignalCounts> counts(int fd) = 0;
  // Waits until cts, dsr, cd or ri changes. 0, or the error number: EINTR after a signal.
  virtual int wait_for_change(int fd) = 0;
};

}  // namespace porttape
