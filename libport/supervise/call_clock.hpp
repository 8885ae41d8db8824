#pragma once

#include <functional>
#include <utility>

#include "libport/loop/timer.hpp"

namespace porttape {

// The time by which kept calls are answered, and one wake-up by it. A clock of another kind than the real one
// makes its programs' time another.
class CallClock {
 public:
  virtual ~CallClock() = default;
  [[nodiscard]] virtual Instant now() const = 0;
  // Replaces the last; the callback is the one of on_wake().
  virtual void wake_at(Instant when) = 0;
  virtual void sleep() = 0;

  void on_wake(std::function<void()> callback) { callback_ = std::move(callback); }

 protected:
  void wake() const {
    if (callback_) callback_();
  }

 private:
  std::function<void()> callback_;
};

// The machine's own.
class RealClock final : public CallClock {
 public:
  explicit RealClock(Loop& loop) : timer_(loop, [this] { wake(); }) {}
  [[nodiscard]] Instant now() const override { return Loop::now(); }
  void wake_at(Instant when) override { timer_.set(when); }
  void sleep() override { timer_.cancel(); }

 private:
  Timer timer_;
};

}  // namespace porttape
