#pragma once

#include <chrono>
#include <optional>

#include "libport/base/time.hpp"

namespace porttape {

// Whether a command under test has nothing more to do: for kLimit nothing was due, nothing came, and all its
// processes slept. Time is told; look() is to be called every kPeriod.
class IdleWatch {
 public:
  static constexpr Nanos kLimit = std::chrono::seconds(10);
  static constexpr Nanos kPeriod = std::chrono::seconds(1);

  // `idle`: what was just seen. True once it has been so for kLimit.
  bool look(Instant now, bool idle) {
    if (!idle) {
      since_.reset();
    } else if (!since_) {
      since_ = now;
    }
    return since_ && now - *since_ >= kLimit;
  }

 private:
  std::optional<Instant> since_;
};

}  // namespace porttape
