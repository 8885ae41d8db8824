#pragma once

#include <algorithm>
#include <cstdint>

#include "libport/tape/byte_source.hpp"

namespace porttape {

// Where a file was written at all. No driver and no device sends a million zeros at once, and file systems
// keep holes where a machine stopped before its data came to the disk: what has a long hole in it is no
// recording. Short ones may be zeros that a copy has left out. Refers to the source.
class StoredBytes {
 public:
  static constexpr std::uint64_t kLongHole = std::uint64_t{1} << 20U;  // bytes; what is longer is no data

  explicit StoredBytes(ByteSource& source) : source_(&source) {}

  // The same offset, or where data goes on if a long hole begins there or before.
  [[nodiscard]] std::uint64_t behind_hole(std::uint64_t offset) {
    if (offset < known_.begin || offset >= known_.end) {
      known_ = source_->stored(offset);
      ++calls_;
    }
    const std::uint64_t data = std::max(known_.begin, offset);
    return data - offset > kLongHole ? data : offset;
  }

  // Whether a long hole is among the bytes from `begin` up to `end`. Asks the file system once for each hole
  // there, up to the first long one.
  [[nodiscard]] bool has_hole(std::uint64_t begin, std::uint64_t end) {
    while (begin < end && end - begin > kLongHole) {
      if (behind_hole(begin) != begin) return true;
      begin = std::max(known_.end, begin + 1);
    }
    return false;
  }

  // How many of the first `size` bytes are in no long hole. Blocks of the disk would not tell: a file system
  // may compress data, and may give those to a new file only later.
  [[nodiscard]] std::uint64_t count(std::uint64_t size) {
    std::uint64_t all = 0;
    for (std::uint64_t at = behind_hole(0); at < size; at = behind_hole(at)) {
      const std::uint64_t end = std::clamp(known_.end, at + 1, size);
      all += end - at;
      at = end;
    }
    return all;
  }

  // To the source, so far.
  [[nodiscard]] std::int64_t calls() const { return calls_; }

 private:
  ByteSource* source_;
  ByteSource::Stretch known_;  // the last that was asked for
  std::int64_t calls_ = 0;
};

}  // namespace porttape
