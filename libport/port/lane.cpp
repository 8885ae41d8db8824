#include "libport/port/lane.hpp"

#include <algorithm>
#include <utility>

namespace porttape {

Lane::Lane(Loop& loop, Way way) : loop_(&loop), way_(std::move(way)), timer_(loop, [this] { run(); }) {}

void Lane::put(ByteView data, Instant due) {
  if (empty() && (hurry_ || due <= loop_->now()) && way_.open()) return way_.pass(data);
  hold({due, Bytes(data.begin(), data.end()), {}, Instant::max()});
}

void Lane::put(std::function<void()> event, Instant waits_until) {
  if (empty()) return event();
  hold({{}, {}, std::move(event), waits_until});
}

void Lane::hold(Step step) {
  bytes_ += step.data.size();
  steps_.push_back(std::move(step));
  run();
}

Lane::Step Lane::take() {
  Step step = std::move(steps_.front());
  steps_.pop_front();
  bytes_ -= step.data.size();
  return step;
}

// Of the next thing to be done; nothing: there is none that a moment brings.
std::optional<Instant> Lane::due(bool open) const {
  if (empty()) return std::nullopt;
  if (open) return steps_.front().due;
  if (steps_.front().event) return Instant{};
  const Instant first = std::ranges::min_element(steps_, {}, &Step::waits_until)->waits_until;
  return first == Instant::max() ? std::nullopt : std::optional(first);
}

void Lane::run() {
  for (;;) {
    const bool open = way_.open();
    const std::optional<Instant> next = due(open);
    const bool now = next && ((open && hurry_) || *next <= loop_->now());
    if (!now) break;
    less_ = true;
    const Step step = take();
    if (step.event) {
      step.event();
    } else if (open) {
      way_.pass(step.data);
    } else {
      way_.given_up(step.data.size());
    }
  }
  arm();
  if (std::exchange(less_, false)) way_.less();
}

void Lane::let_go() {
  for (Step& step : steps_) step.due = {};
  run();
}

void Lane::arm() {
  if (const std::optional<Instant> next = due(way_.open())) {
    timer_.set(*next);
  } else {
    timer_.cancel();
  }
}

void Lane::hurry(bool on) {
  hurry_ = on;
  if (on) run();
}

std::size_t Lane::drop() {
  std::size_t bytes = 0;
  while (!empty()) {
    const Step step = take();
    bytes += step.data.size();
    if (step.event) step.event();
  }
  arm();
  less_ = false;
  return bytes;
}

}  // namespace porttape
