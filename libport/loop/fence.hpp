#pragma once

#include <functional>
#include <string>

namespace porttape {

// Where exceptions end that leave callbacks of a loop: those of one channel, whose trouble is its own. See
// Loop::within().
struct Fence {
  // Called from the loop, with what() of the exception. What threw may be left half done: it should be
  // destroyed before long, but not from within this call.
  std::function<void(const std::string& what)> on_exception;
};

}  // namespace porttape
