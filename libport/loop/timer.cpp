#include "libport/loop/timer.hpp"

#include <algorithm>
#include <utility>

#include "libport/loop/timer_queue.hpp"

namespace porttape {

struct Timer::State final : TimerQueue::Entry, std::enable_shared_from_this<Timer::State> {
  State(Loop& owner, TimerQueue& timers, std::function<void()> cb)
      : loop(&owner), queue(&timers), fence(owner.fence()), callback(std::move(cb)) {}

  void set(Instant when) {
    if (place && place->first == when) return;
    cancel();
    expected = std::max(when, queue->clock().now());  // one that is set for the past is not late
    place = queue->put(when, shared_from_this());
  }

  void cancel() {
    if (place) queue->remove(*std::exchange(place, std::nullopt));
  }

  void on_due(const TimerQueue::Place& of) override {
    if (place != of) return;
    place.reset();
    loop->timer_comes(*queue, expected);
    loop->within(fence, callback);
  }

  Loop* loop;
  TimerQueue* queue;
  std::shared_ptr<Fence> fence;
  std::function<void()> callback;
  std::optional<TimerQueue::Place> place;  // while it is set
  Instant expected{};
};

Timer::Timer(Loop& loop, std::function<void()> callback, By by)
    : state_(std::make_shared<State>(loop, by == By::loop ? loop.timers() : loop.machine_timers(),
                                     std::move(callback))) {}
Timer::~Timer() { state_->cancel(); }
void Timer::set(Instant when) { state_->set(when); }
void Timer::set_after(Nanos delay) { set(state_->queue->clock().now() + delay); }
void Timer::cancel() { state_->cancel(); }
std::optional<Instant> Timer::due() const {
  if (!state_->place) return std::nullopt;
  return state_->place->first;
}

}  // namespace porttape
