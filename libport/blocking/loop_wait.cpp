#include "libport/blocking/loop_wait.hpp"

#include <algorithm>
#include <chrono>

namespace porttape {
namespace {

constexpr Nanos kFirstPulse = std::chrono::microseconds(100);
constexpr Nanos kLongestPulse = std::chrono::milliseconds(5);

}  // namespace

// Where other threads find a wait.
class LoopWait::Listed {
 public:
  Listed(std::vector<Wait*>& waits, Wait& wait) : waits_(&waits), wait_(&wait) { waits.push_back(&wait); }
  ~Listed() { std::erase(*waits_, wait_); }
  Listed(const Listed&) = delete;
  Listed& operator=(const Listed&) = delete;

 private:
  std::vector<Wait*>* waits_;
  Wait* wait_;
};

LoopWait::LoopWait(Loop& loop)
    : loop_(&loop), turn_([post = loop.poster()] {
        post([] {});  // an event, so that run_one() returns
      }) {}

void LoopWait::poll() {
  loop_->restart();
  while (loop_->poll_one()) {
  }
}

LoopWait::End LoopWait::until(const Condition& ready, Micros timeout) {
  Wait wait{.ready = &ready};
  return run(wait, timeout);
}

LoopWait::End LoopWait::until_or_quiet(const Condition& ready, Micros timeout) {
  Wait wait{.ready = &ready, .quiet = timeout};
  return run(wait, timeout);
}

LoopWait::End LoopWait::run(Wait& wait, Micros timeout) {
  poll();
  if ((*wait.ready)()) return End::ready;
  if (timeout == Micros{0}) return End::timed_out;
  if (timeout > Micros{0}) {
    wait.limit.emplace(*loop_, [&wait] { wait.timed_out = true; });
    wait.limit->set_after(timeout);
  }
  const Listed listed(waits_, wait);
  while (!(*wait.ready)()) {
    if (wait.timed_out) return End::timed_out;
    if (turn(wait) == Turned::stalled) return End::stalled;
  }
  return End::ready;
}

LoopWait::Turned LoopWait::turn(Wait& wait) {
  hurry_others(&wait);
  if (!turn_.begin_sleep()) {
    // Where nothing else is left on the loop, the others are to notice it.
    if (wait.holds_loop) wait.limit.reset();
    turn_.step_back(wait.seat);
    return Turned::stepped_back;
  }
  struct EndSleep {  // also when a handler throws
    LoopTurn* turn;
    ~EndSleep() { turn->end_sleep(); }
  };
  const EndSleep at_end{&turn_};
  loop_->restart();
  return loop_->run_one() ? Turned::ran : Turned::stalled;
}

void LoopWait::hurry_others(const Wait* except) {
  for (Wait* const other : waits_) {
    if (other != except && (other->timed_out || (*other->ready)())) turn_.hurry(other->seat);
  }
}

void LoopWait::progress() {
  for (Wait* const wait : waits_) {
    if (wait->quiet > Micros{0}) wait->limit->set_after(wait->quiet);
  }
}

LoopWait::End LoopWait::until_seen(const Condition& ready, Micros timeout) {
  Nanos every = kFirstPulse;
  Timer pulse(*loop_, [&] {
    every = std::min(every * 2, kLongestPulse);
    pulse.set_after(every);
  });
  pulse.set_after(every);
  return until(ready, timeout);
}

void LoopWait::until_next_call(const Condition& ready) {
  Wait wait{.ready = &ready, .holds_loop = true};
  wait.limit.emplace(*loop_, [] {});
  wait.limit->set(Instant::max());  // something to wait for, so that the loop sleeps
  const Listed listed(waits_, wait);
  while (!ready() && turn(wait) == Turned::ran) {
  }
}

}  // namespace porttape
