#pragma once

#include <cstddef>
#include <cstdint>

#include "libport/base/bytes.hpp"

namespace porttape::bench {

// The byte stream every flood sends and every sink expects: pseudo-random, its period a prime longer than any
// read, so a lost, doubled or moved byte shows. Any window of up to kWindow bytes is contiguous in memory.
inline constexpr std::size_t kPatternPeriod = 65521;
inline constexpr std::size_t kWindow = 65536;

const Byte* pattern_at(std::uint64_t offset);

// Whether `data` stands at `offset` of the stream; size at most kWindow.
bool is_pattern(std::uint64_t offset, const Byte* data, std::size_t size);

}  // namespace porttape::bench
