#pragma once

#include <cstdint>
#include <functional>

#include "libport/base/time.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/timer.hpp"

namespace porttape {

// Turns a loop that nobody else runs until something has happened on it. Timeouts: negative waits for ever, 0
// does not wait. One wait at a time.
class LoopWait {
 public:
  enum class End : std::uint8_t {
    ready,      // the condition holds
    timed_out,  // the timeout passed first
    stalled     // nothing is left on the loop that could make it hold
  };
  using Condition = std::function<bool()>;

  // `loop` must outlive this.
  explicit LoopWait(Loop& loop);

  // Does what is due, without waiting.
  void poll();
  End until(const Condition& ready, Micros timeout);
  // The timeout begins again with each progress().
  End until_or_quiet(const Condition& ready, Micros timeout);
  void progress();
  // For a condition that no event tells of: looked at after 0.1 ms, 0.2 ms, … 5 ms, too.
  End until_seen(const Condition& ready, Micros timeout);

 private:
  Loop* loop_;
  Timer limit_;
  Timer pulse_;
  Nanos pulse_every_{};
  Micros quiet_limit_{};  // of the wait under way
  bool timed_out_ = false;
};

}  // namespace porttape
