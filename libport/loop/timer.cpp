#include "libport/loop/timer.hpp"

#include <algorithm>
#include <cstdint>
#include <utility>

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>

namespace porttape {

struct Timer::State : std::enable_shared_from_this<Timer::State> {
  State(Loop& owner, std::function<void()> cb)
      : loop(&owner), fence(owner.fence()), timer(owner.io()), callback(std::move(cb)) {}

  void set(Instant when) {
    if (due == when) return;
    due = when;
    expected = std::max(when, Loop::now());  // one that is set for the past is not late
    timer.expires_at(when);
    timer.async_wait(
        [self = shared_from_this(), round = ++generation](const boost::system::error_code& error) {
          if (error || round != self->generation || !self->due) return;
          self->loop->timer_comes(self->expected);
          self->due.reset();
          self->loop->within(self->fence, self->callback);
        });
  }

  void cancel() {
    if (!due) return;
    due.reset();
    ++generation;
    timer.cancel();
  }

  Loop* loop;
  std::shared_ptr<Fence> fence;
  boost::asio::steady_timer timer;
  std::function<void()> callback;
  std::optional<Instant> due;
  Instant expected{};
  std::uint64_t generation =
      0;  // a wait that was replaced while its callback was already queued is recognised by it
};

Timer::Timer(Loop& loop, std::function<void()> callback)
    : state_(std::make_shared<State>(loop, std::move(callback))) {}
Timer::~Timer() { state_->cancel(); }
void Timer::set(Instant when) { state_->set(when); }
void Timer::cancel() { state_->cancel(); }
std::optional<Instant> Timer::due() const { return state_->due; }

}  // namespace porttape
