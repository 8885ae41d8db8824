#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "libport/loop/loop.hpp"

namespace porttape {

// Calls back once at a moment of the loop's clock, never before it. Setting it again replaces the moment.
// The callback may destroy the timer. Loop thread only.
class Timer {
 public:
  // Which clock a timer goes by.
  enum class By {
    loop,     // the one that the loop was given
    machine,  // the machine's, whatever clock the loop has: for looks at what runs by real time
  };

  Timer(Loop& loop, std::function<void()> callback, By by = By::loop);
  ~Timer();
  Timer(const Timer&) = delete;
  Timer& operator=(const Timer&) = delete;

  void set(Instant when);
  void set_after(Nanos delay);
  void cancel();
  [[nodiscard]] std::optional<Instant> due() const;

 private:
  struct State;
  friend class TimerQueue;

  std::shared_ptr<State> state_;
};

}  // namespace porttape
