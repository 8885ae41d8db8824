#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace porttape {

// How much work aligning may still be: steps of comparing. What goes beyond is aligned less well, in time
// that grows with the lengths alone.
struct AlignmentEffort {
  std::uint64_t steps = 300'000'000;
};

enum class HardRanges : std::uint8_t {
  left,    // where much differs and nothing unique holds it together, nothing is paired
  aligned  // something is, perhaps not the most
};

inline constexpr std::uint32_t kNoPartner = std::numeric_limits<std::uint32_t>::max();

// Pairs equal elements of two sequences, ascending in both: for each of `one` the index in `other`, or
// kNoPartner. As many as can be (Myers) where few differ; else around what is unique in both (patience).
std::vector<std::uint32_t> align_sequences(std::span<const std::uint64_t> one,
                                           std::span<const std::uint64_t> other, AlignmentEffort& effort,
                                           HardRanges hard = HardRanges::aligned);

}  // namespace porttape
