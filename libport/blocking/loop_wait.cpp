#include "libport/blocking/loop_wait.hpp"

#include <algorithm>
#include <chrono>

namespace porttape {
namespace {

constexpr Nanos kFirstPulse = std::chrono::microseconds(100);
constexpr Nanos kLongestPulse = std::chrono::milliseconds(5);

}  // namespace

LoopWait::LoopWait(Loop& loop)
    : loop_(&loop), limit_(loop, [this] { timed_out_ = true; }), pulse_(loop, [this] {
        pulse_every_ = std::min(pulse_every_ * 2, kLongestPulse);
        pulse_.set_after(pulse_every_);
      }) {}

void LoopWait::poll() {
  loop_->restart();
  while (loop_->poll_one()) {
  }
}

LoopWait::End LoopWait::until(const Condition& ready, Micros timeout) {
  poll();
  if (ready()) return End::ready;
  if (timeout == Micros{0}) return End::timed_out;
  timed_out_ = false;
  if (timeout > Micros{0}) limit_.set_after(timeout);
  End end = End::ready;
  loop_->restart();
  while (end == End::ready && !ready()) {
    if (timed_out_) {
      end = End::timed_out;
    } else if (!loop_->run_one()) {
      end = End::stalled;
    }
  }
  limit_.cancel();
  return end;
}

LoopWait::End LoopWait::until_or_quiet(const Condition& ready, Micros timeout) {
  quiet_limit_ = timeout;
  const End end = until(ready, timeout);
  quiet_limit_ = {};
  return end;
}

void LoopWait::progress() {
  if (quiet_limit_ > Micros{0}) limit_.set_after(quiet_limit_);
}

LoopWait::End LoopWait::until_seen(const Condition& ready, Micros timeout) {
  pulse_every_ = kFirstPulse;
  pulse_.set_after(pulse_every_);
  const End end = until(ready, timeout);
  pulse_.cancel();
  return end;
}

}  // namespace porttape
