#pragma once

#include <functional>
#include <initializer_list>
#include <memory>

#include "libport/loop/loop.hpp"

namespace porttape {

// Calls back, from the loop, for each of these signals; nothing else happens at them then. One a signal and
// process. Loop thread only.
class SignalWatch {
 public:
  SignalWatch(Loop& loop, std::function<void(int number)> callback);
  ~SignalWatch();
  SignalWatch(const SignalWatch&) = delete;
  SignalWatch& operator=(const SignalWatch&) = delete;

  void add(std::initializer_list<int> numbers);

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace porttape
