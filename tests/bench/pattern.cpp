#include "tests/bench/pattern.hpp"

#include <cstring>
#include <random>

namespace porttape::bench {

const Byte* pattern_at(std::uint64_t offset) {
  static const Bytes stream = [] {
    std::mt19937 random(20240229);
    Bytes bytes(kPatternPeriod + kWindow);
    for (std::size_t i = 0; i < kPatternPeriod; ++i) bytes[i] = static_cast<Byte>(random());
    for (std::size_t i = kPatternPeriod; i < bytes.size(); ++i) bytes[i] = bytes[i - kPatternPeriod];
    return bytes;
  }();
  return stream.data() + offset % kPatternPeriod;
}

bool is_pattern(std::uint64_t offset, const Byte* data, std::size_t size) {
  return std::memcmp(pattern_at(offset), data, size) == 0;
}

}  // namespace porttape::bench
