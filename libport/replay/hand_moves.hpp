#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "libport/base/time.hpp"
#include "libport/replay/timeline.hpp"

namespace porttape {

// How a played clock was moved forward by hand, so that a silence can be told from a move: what was passed
// over in a moment gave nobody time to write. Each move is at one real moment, so that nothing happens inside
// one. Memory is bounded: the oldest moves are kept as one at the latest of their places, which can only make
// a silence longer. A plain value.
class HandMoves {
 public:
  // From `from` to `to`, both played; `from` is never before the last one's `to`.
  void add(Instant from, Instant to) {
    if (moves_.size() == kMost) {
      moves_[1].length += moves_[0].length;
      moves_.erase(moves_.begin());
    }
    moves_.push_back({to, to - from});
  }

  // When, by the played clock, `length` has passed since `since` without the moves made since then.
  [[nodiscard]] Instant after(Instant since, Nanos length) const {
    Instant end = saturating_add(since, length);
    const auto first = std::ranges::upper_bound(moves_, since, {}, &Move::to);
    for (auto move = first; move != moves_.end(); ++move)
      end = saturating_add(end, std::min(move->length, move->to - since));
    return end;
  }

 private:
  static constexpr std::size_t kMost = 64;
  struct Move {
    Instant to{};
    Nanos length{};
  };
  std::vector<Move> moves_;
};

}  // namespace porttape
