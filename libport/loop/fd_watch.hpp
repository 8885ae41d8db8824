#pragma once

#include <chrono>
#include <functional>
#include <memory>

#include "libport/loop/loop.hpp"

namespace porttape {

// Tells when a descriptor can be read or written. Does not own the descriptor, which must stay open until
// this is gone. Level semantics: while watched, the callback comes again as long as the condition holds. A
// callback may destroy the watch. Loop thread only.
//
// A descriptor that the kernel does not watch (limits, or of a kind that has no events) is looked at every
// kLook instead.
class FdWatch {
 public:
  using Callback = std::function<void()>;
  static constexpr Nanos kLook = std::chrono::milliseconds(10);

  FdWatch(Loop& loop, int fd, Callback on_readable, Callback on_writable = {}, Callback on_hang_up = {});
  ~FdWatch();
  FdWatch(const FdWatch&) = delete;
  FdWatch& operator=(const FdWatch&) = delete;

  void watch_readable(bool on);
  void watch_writable(bool on);
  // For one that is not read: a hang-up or an error also makes it readable.
  void watch_hang_up(bool on);

  // Ends the watch for good: the descriptor may be closed afterwards.
  void stop();

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace porttape
