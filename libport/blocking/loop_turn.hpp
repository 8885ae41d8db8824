#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <utility>
#include <vector>

namespace porttape {

// Lets one thread at a time use things that are not thread-safe. Unlike a mutex it can be lent: a thread that
// has the turn and only sleeps until something happens is woken when another thread wants the turn, steps
// back, and gets the turn again later.
//
// Drive it: take(), then use the things, then give(). To wait in between: while begin_sleep(), sleep and
// end_sleep(); when begin_sleep() refuses, step_back(). Any thread may call take(); the other functions are
// for the thread that has the turn.
class LoopTurn {
 public:
  // Where a thread waits for the turn. Belongs to that thread.
  class Seat {
   private:
    friend class LoopTurn;
    std::condition_variable called_;
    bool has_turn_ = false;
  };

  // `wake` ends the sleep of another thread, also one that only begins after the call. It must not throw.
  explicit LoopTurn(std::function<void()> wake) : wake_(std::move(wake)) {}
  LoopTurn(const LoopTurn&) = delete;
  LoopTurn& operator=(const LoopTurn&) = delete;

  // Waits until the thread that has the turn gives it, or wakes that thread if it sleeps.
  void take();
  // Passes the turn to the thread that has waited longest: of those that are in a hurry if there are any,
  // else of those that have stepped back.
  void give();

  // False if a thread in a hurry waits for the turn. Otherwise take() ends the sleep, until end_sleep().
  [[nodiscard]] bool begin_sleep();
  void end_sleep();
  // Passes the turn on as give() does and waits at `seat` until it comes back.
  void step_back(Seat& seat);
  // Puts a thread that has stepped back to `seat` in a hurry. No effect on one that is in a hurry, or that
  // has not stepped back.
  void hurry(Seat& seat);

 private:
  using Lock = std::unique_lock<std::mutex>;

  void pass_on();
  static void wait(Seat& seat, Lock& lock);

  const std::function<void()> wake_;
  std::mutex mutex_;  // guards the rest, and the seats
  bool taken_ = false;
  bool sleeping_ = false;
  std::vector<Seat*> hurried_;  // the longest waiting first
  std::vector<Seat*> patient_;
};

}  // namespace porttape
