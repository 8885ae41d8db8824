#pragma once

#include <functional>
#include <initializer_list>
#include <memory>

#include "libport/loop/loop.hpp"

namespace porttape {

// Calls back, from the loop, for each of these signals; nothing else happens at them then, and nothing at all
// once the watch has gone: what a program does at its end is not cut short. One a process at a time. Loop
// thread only.
class SignalWatch {
 public:
  // std::system_error: no descriptors are left.
  SignalWatch(Loop& loop, std::function<void(int number)> callback);
  ~SignalWatch();
  SignalWatch(const SignalWatch&) = delete;
  SignalWatch& operator=(const SignalWatch&) = delete;

  void add(std::initializer_list<int> numbers);

  // In the callback: whether the terminal sent it (Ctrl-C), and with it to the whole foreground group.
  [[nodiscard]] bool from_terminal() const;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace porttape
