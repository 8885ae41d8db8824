#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "libport/loop/loop.hpp"

namespace porttape {

// Calls back once at a moment of the monotonic clock, never before it. Setting it again replaces the moment.
// The callback may destroy the timer. Loop thread only.
class Timer {
 public:
  Timer(Loop& loop, std::function<void()> callback);
  ~Timer();
  Timer(const Timer&) = delete;
  Timer& operator=(const Timer&) = delete;

  void set(Instant when);
  void set_after(Nanos delay) { set(Loop::now() + delay); }
  void cancel();
  [[nodiscard]] std::optional<Instant> due() const;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace porttape
