#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <vector>

namespace porttape {

// How well item `a` of one sequence and item `b` of another go together: 0 not at all, at most 1.
using Likeness = std::function<double(std::size_t a, std::size_t b)>;

// Two sequences side by side: each step has an item of both, or of one alone. Items keep their order.
struct AlignedPair {
  std::optional<std::size_t> a;
  std::optional<std::size_t> b;
  friend bool operator==(const AlignedPair&, const AlignedPair&) = default;
};

// The alignment with the greatest sum of likenesses (Needleman and Wunsch). Items with likeness 0 are never
// put together. Where several are as good, what stands alone stands as far behind as it can. Time and memory
// are `a_size * b_size`; at most kMostCells of them.
std::vector<AlignedPair> align(std::size_t a_size, std::size_t b_size, const Likeness& likeness);

inline constexpr std::size_t kMostCells = std::size_t{64} << 20U;

// The same for any number of sequences, each joined to those before it: a column has an item of each, or
// none.
using Column = std::vector<std::optional<std::size_t>>;

// How well items `a` of sequence `of_a` and `b` of sequence `of_b` go together.
using LikenessOf = std::function<double(std::size_t of_a, std::size_t a, std::size_t of_b, std::size_t b)>;

std::vector<Column> align_all(std::span<const std::size_t> sizes, const LikenessOf& likeness);

}  // namespace porttape
