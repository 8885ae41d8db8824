#pragma once

#include <chrono>
#include <cstddef>
#include <optional>

#include "libport/base/end_wait.hpp"
#include "libport/base/time.hpp"

namespace porttape {

// How long a device is given for the last bytes of a driver that has closed: as long as it takes some, and
// while a next driver waits, kLimit in all and kLook without progress. Time is an argument.
//
// Drive it: begin(); next_driver() when one comes; goes_on() at once and each kLook.
class LastBytes {
 public:
  // As a tty's own closing_wait. It is for standing still, and in all where nobody knows how many are left.
  static constexpr Nanos kLimit = std::chrono::seconds(30);
  static constexpr Nanos kLook = std::chrono::seconds(1);

  void begin(Instant now) {
    wait_.emplace(now, kLimit);
    until_.reset();
  }
  // `left` bytes have not been taken yet, nothing where that is not known.
  void next_driver(Instant now, std::optional<std::size_t> left) {
    left_ = left;
    until_ = now + kLimit;
  }
  // False: they are dropped.
  [[nodiscard]] bool goes_on(Instant now, std::optional<std::size_t> left) {
    const bool stands_still = until_ && left && left == left_;
    const bool goes_on = wait_->goes_on(now, left) && (!until_ || now < *until_);
    left_ = left;
    return goes_on && !stands_still;
  }

 private:
  std::optional<EndWait> wait_;
  std::optional<Instant> until_;     // where a next driver waits
  std::optional<std::size_t> left_;  // at the last look
};

}  // namespace porttape
