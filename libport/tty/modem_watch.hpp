#pragma once

#include <functional>
#include <future>
#include <memory>
#include <optional>

#include "libport/line/line_signal.hpp"
#include "libport/loop/loop.hpp"
#include "libport/tty/line_calls.hpp"

namespace porttape {

// Tells what the device does with its signals: cts, dsr, cd, ri, and breaks of its own.
//
// A thread waits in the driver (TIOCMIWAIT) and looks after each change. One that falls between a look and
// the next wait is told by no wait: a look every 100 ms finds it, and breaks, for which that wait does not
// end either, unless look_soon() is called. Where there is no such wait, it looks every 10 ms. A pulse that
// is over when it looks is known by the driver's counters, where it has any: of several between two looks
// one is told, off and on or on and off; a break is told as on and off.
//
// The thread has a duplicate of the descriptor and closes it when it ends: where the tty is gone or has no
// modem lines, or when the watch is destroyed. That waits for nothing: a signal (SIGURG, whose handler here
// does nothing and restarts no call) is sent to the thread again and again, by a timer of the kernel, until
// it has ended. A device that hangs keeps its thread. Loop thread only.
class ModemWatch {
 public:
  using Tell = std::function<void(const LineSignal&)>;

  // Told on the loop, never after this is destroyed: the four lines where they are otherwise than in `known`
  // (modem_lines() of before), or all of them without it; then each change. Null where no thread, timer or
  // descriptor is to be had, or another has the signal.
  static std::unique_ptr<ModemWatch> start(Loop& loop, std::shared_ptr<LineCalls> calls, int fd,
                                           std::optional<int> known, Tell tell);
  ~ModemWatch();
  ModemWatch(const ModemWatch&) = delete;
  ModemWatch& operator=(const ModemWatch&) = delete;

  // There may be a break to be told.
  void look_soon();
  // Ready once the thread has closed its descriptor.
  [[nodiscard]] std::shared_future<void> left() const;

 private:
  struct Thread;

  explicit ModemWatch(std::shared_ptr<Thread> thread);

  std::shared_ptr<Thread> thread_;
  std::shared_ptr<Tell> tell_;  // of the loop's thread; the other one has it weakly
};

// TIOCM_CTS and so on; 0 of a break, and of what the device does not drive.
int modem_bit(LineSignal::Name name);

// Calls `tell` with each of the four lines that is otherwise in `lines`; without `before`, with all.
void tell_modem_lines(std::optional<int> before, int lines, const ModemWatch::Tell& tell);

}  // namespace porttape
