#pragma once

#include <cstddef>

namespace porttape {

// How much of the tape one call of the engine may read, well under a millisecond of work. What is left over
// goes on at the next call, so that a tape of nothing but empty blocks never holds up the thread.
//
// refill() at the start of a call; who reads a record spends it, and asks spent() before the next one.
class Budget {
 public:
  static constexpr std::size_t kRecords = 4096;
  static constexpr std::size_t kBytes = std::size_t{256} * 1024;

  void refill() {
    records_ = kRecords;
    bytes_ = kBytes;
  }
  void spend(std::size_t bytes) {
    records_ -= records_ > 0 ? 1 : 0;
    bytes_ -= bytes_ > bytes ? bytes : bytes_;
  }
  [[nodiscard]] bool spent() const { return records_ == 0 || bytes_ == 0; }

 private:
  std::size_t records_ = kRecords;
  std::size_t bytes_ = kBytes;
};

}  // namespace porttape
