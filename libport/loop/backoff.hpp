#pragma once

#include <algorithm>

#include "libport/base/time.hpp"

namespace porttape {

// How long to wait before what has failed is tried again: twice as long each time, up to a limit. A value.
class Backoff {
 public:
  constexpr Backoff(Nanos first, Nanos longest) : first_(first), longest_(longest), next_(first) {}

  // The next wait.
  constexpr Nanos next() {
    const Nanos now = next_;
    next_ = std::min(next_ * 2, longest_);
    return now;
  }
  constexpr void reset() { next_ = first_; }
  // Nothing was tried since the beginning, or the last reset().
  [[nodiscard]] constexpr bool is_first() const { return next_ == first_; }

 private:
  Nanos first_;
  Nanos longest_;
  Nanos next_;
};

// A line that has been up for so long has worked: what happens to it then begins a new story.
inline constexpr Nanos kLineHeld = std::chrono::seconds(1);

}  // namespace porttape
