#pragma once

#include <cstdint>

namespace porttape {

// Counts the exchanges of a tape, told its blocks in order: a run of writes, and the reads up to the next
// write. An open or a close ends one.
class ExchangeCount {
 public:
  // Whether an exchange begins with it.
  bool on_write() {
    if (asking_) return false;
    asking_ = true;
    ++count_;
    return true;
  }
  // Whether it is the first answer of an exchange.
  bool on_read() {
    const bool answers = asking_;
    asking_ = false;
    return answers;
  }
  void on_open_or_close() { asking_ = false; }

  [[nodiscard]] std::uint64_t count() const { return count_; }

 private:
  bool asking_ = false;
  std::uint64_t count_ = 0;
};

}  // namespace porttape
