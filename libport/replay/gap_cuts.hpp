#pragma once

#include <algorithm>
#include <cstddef>
#include <deque>
#include <iterator>
#include <optional>

#include "libport/base/time.hpp"

namespace porttape {

// The tape's time without what is too long of its idle gaps: told where the walk goes, it maps the tape's
// time to that of a tape whose gaps are cut. Bounded: the oldest of many cuts are forgotten, as nobody asks
// for times so far behind the walk.
class GapCuts {
 public:
  static constexpr std::size_t kMost = 4096;

  // Nothing: no gap is too long.
  explicit GapCuts(std::optional<Micros> longest) : longest_(longest) {}

  // The walk goes on from there.
  void begin(TapeTime at) {
    reached_ = at;
    cuts_.clear();
  }
  // Something is recorded at `at`, behind all that was told before.
  void reach(TapeTime at) {
    if (longest_ && at - reached_ > *longest_) {
      cuts_.push_back({at, total() + (at - reached_ - *longest_)});
      if (cuts_.size() > kMost) cuts_.pop_front();
    }
    reached_ = std::max(reached_, at);
  }
  [[nodiscard]] TapeTime reached() const { return reached_; }
  [[nodiscard]] bool any_possible() const { return longest_.has_value(); }

  [[nodiscard]] TapeTime cut(TapeTime at) const {
    if (cuts_.empty()) return at;
    const auto after = std::ranges::upper_bound(cuts_, at, {}, &Cut::at);
    return after == cuts_.begin() ? at : at - std::prev(after)->total;
  }
  // The tape's time of a time of the cut tape.
  [[nodiscard]] TapeTime uncut(TapeTime at) const {
    const auto after =
        std::ranges::upper_bound(cuts_, at, {}, [](const Cut& cut) { return cut.at - cut.total; });
    return after == cuts_.begin() ? at : at + std::prev(after)->total;
  }

 private:
  struct Cut {
    TapeTime at{};   // the end of the gap
    Micros total{};  // cut so far
  };

  [[nodiscard]] Micros total() const { return cuts_.empty() ? Micros{} : cuts_.back().total; }

  std::optional<Micros> longest_;
  TapeTime reached_{};
  std::deque<Cut> cuts_;
};

}  // namespace porttape
