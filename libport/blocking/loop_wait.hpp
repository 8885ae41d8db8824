#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "libport/base/time.hpp"
#include "libport/blocking/loop_turn.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/timer.hpp"

namespace porttape {

// Turns a loop that nobody else runs until something has happened on it, for calls of several threads. Each
// call has a timeout of its own. Timeouts: negative waits for ever, 0 does not wait.
//
// One thread at a time has the turn (Call): it alone may use the loop and what lives on it. A wait lends the
// turn to calls that come meanwhile, so anything may have changed when it returns. One of the waiting threads
// runs the loop for all of them, and looks at the conditions of the others too.
class LoopWait {
 public:
  enum class End : std::uint8_t {
    ready,      // the condition holds
    timed_out,  // the timeout passed first
    stalled     // nothing is left on the loop that could make it hold
  };
  // Called by any thread that has the turn; must not wait.
  using Condition = std::function<bool()>;

  // The turn, for a call of the thread that makes this. May not be nested.
  class Call {
   public:
    explicit Call(LoopWait& wait) : wait_(&wait) { wait_->turn_.take(); }
    // A wait that is over has the turn next, whoever else wants it.
    ~Call() {
      wait_->hurry_others(nullptr);
      wait_->turn_.give();
    }
    Call(const Call&) = delete;
    Call& operator=(const Call&) = delete;

   private:
    LoopWait* wait_;
  };

  // `loop` must outlive this.
  explicit LoopWait(Loop& loop);

  // The others are for a thread that has a Call.

  // Does what is due, without waiting.
  void poll();
  End until(const Condition& ready, Micros timeout);
  // The timeout begins again with each progress().
  End until_or_quiet(const Condition& ready, Micros timeout);
  void progress();
  // For a condition that no event tells of: looked at after 0.1 ms, 0.2 ms, … 5 ms, too.
  End until_seen(const Condition& ready, Micros timeout);
  // Waits for the condition, or until another thread has had the turn; for a loop on which nothing is left.
  void until_next_call(const Condition& ready);

 private:
  // A wait that is under way: of the thread that runs the loop, or of one that has stepped back.
  struct Wait {
    const Condition* ready;
    Micros quiet{};  // the timeout that begins again; 0 for one that does not
    bool timed_out = false;
    std::optional<Timer> limit{};
    LoopTurn::Seat seat{};
    bool holds_loop = false;  // `limit` is there only to keep the loop asleep
  };
  class Listed;
  enum class Turned : std::uint8_t { ran, stepped_back, stalled };

  End run(Wait& wait, Micros timeout);
  // One event, unless another thread goes first.
  Turned turn(Wait& wait);
  void hurry_others(const Wait* except);

  Loop* loop_;
  LoopTurn turn_;
  std::vector<Wait*> waits_;
};

}  // namespace porttape
