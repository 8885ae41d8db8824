#pragma once

#include <cstdint>

#include "libport/base/time.hpp"

namespace porttape {

// Which time the tape, or its part, is played. A plain value.
class Loops {
 public:
  // So many in all; 0: for ever.
  explicit Loops(std::uint64_t all) : all_(all) {}

  void begin_first(Instant now) { begin(1, now, false); }
  void begin_next(Instant now) { begin(number_ + 1, now, true); }
  // A further session of the tape begins in this loop.
  void session_began() { fresh_ = false; }
  // Something was delivered.
  void spoke() { spoke_ = true; }

  [[nodiscard]] std::uint64_t number() const { return number_; }  // from 1 on
  [[nodiscard]] bool is_first() const { return number_ == 1; }
  [[nodiscard]] bool is_last() const { return all_ > 0 && number_ >= all_; }
  // No session has begun in it yet, and it is not the first.
  [[nodiscard]] bool fresh() const { return fresh_; }
  [[nodiscard]] bool has_spoken() const { return spoke_; }
  [[nodiscard]] Instant begun() const { return begun_; }

 private:
  void begin(std::uint64_t number, Instant now, bool fresh) {
    number_ = number;
    begun_ = now;
    fresh_ = fresh;
    spoke_ = false;
  }

  std::uint64_t all_;
  std::uint64_t number_ = 1;
  Instant begun_{};
  bool fresh_ = false;
  bool spoke_ = false;
};

}  // namespace porttape
