#include "libport/blocking/loop_turn.hpp"

#include <algorithm>
#include <utility>

namespace porttape {

void LoopTurn::take() {
  Lock lock(mutex_);
  if (!std::exchange(taken_, true)) return;
  Seat seat;
  hurried_.push_back(&seat);
  if (std::exchange(sleeping_, false)) wake_();
  wait(seat, lock);
}

void LoopTurn::give() {
  const Lock lock(mutex_);
  pass_on();
}

bool LoopTurn::begin_sleep() {
  const Lock lock(mutex_);
  sleeping_ = hurried_.empty();
  return sleeping_;
}

void LoopTurn::end_sleep() {
  const Lock lock(mutex_);
  sleeping_ = false;
}

void LoopTurn::step_back(Seat& seat) {
  Lock lock(mutex_);
  patient_.push_back(&seat);
  pass_on();
  wait(seat, lock);
}

void LoopTurn::hurry(Seat& seat) {
  const Lock lock(mutex_);
  if (std::erase(patient_, &seat) > 0) hurried_.push_back(&seat);
}

void LoopTurn::pass_on() {
  std::vector<Seat*>& waiting = hurried_.empty() ? patient_ : hurried_;
  if (waiting.empty()) {
    taken_ = false;
    return;
  }
  Seat& next = *waiting.front();
  waiting.erase(waiting.begin());
  next.has_turn_ = true;
  next.called_.notify_one();
}

void LoopTurn::wait(Seat& seat, Lock& lock) {
  seat.called_.wait(lock, [&] { return seat.has_turn_; });
  seat.has_turn_ = false;
}

}  // namespace porttape
