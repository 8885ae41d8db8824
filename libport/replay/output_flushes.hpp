#pragma once

#include <cstdint>
#include <utility>

namespace porttape {

// Counts how often a driver drops what it has written and the device has not read yet (tcflush). Flushes with
// no byte between them count once, and those before the first byte not at all.
class OutputFlushes {
 public:
  // A flush behind `written` bytes of the driver's stream.
  void add(std::uint64_t written) {
    if (std::exchange(last_, written) != written) ++count_;
  }
  // The stream begins again; what was counted stays.
  void restart() { last_ = 0; }
  [[nodiscard]] std::uint64_t count() const { return count_; }

 private:
  std::uint64_t last_ = 0;
  std::uint64_t count_ = 0;
};

}  // namespace porttape
