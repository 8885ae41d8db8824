#pragma once

#include <algorithm>
#include <cstddef>
#include <deque>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/replay/timeline.hpp"

namespace porttape {

// The latest changes of the rate at which a tape is played. What was asked for before a change and is
// answered after it is played at each rate in its time. Bounded: the oldest of many changes are forgotten.
class RateChanges {
 public:
  // Only a user who changes the rate faster than a driver is answered makes more.
  static constexpr std::size_t kMost = 64;

  void forget() { changes_.clear(); }
  // Until `now` the rate was `before`.
  void add(double before, Instant now) {
    if (changes_.size() == kMost) changes_.pop_front();
    changes_.push_back({now, before});
  }

  // A timeline by which `tape` was played at `real`, which may be before some of the changes; its rate is now
  // `rate`.
  [[nodiscard]] Timeline timeline_from(TapeTime tape, Instant real, double rate) const {
    auto change = std::ranges::upper_bound(changes_, real, {}, &Change::at);
    Timeline timeline(change == changes_.end() ? rate : change->before);
    timeline.anchor(tape, real);
    while (change != changes_.end()) {
      const Instant at = change->at;
      ++change;
      timeline.set_rate(change == changes_.end() ? rate : change->before, at);
    }
    return timeline;
  }
  // The last change, if it came after `real`.
  [[nodiscard]] std::optional<Instant> last_after(Instant real) const {
    if (changes_.empty() || changes_.back().at <= real) return std::nullopt;
    return changes_.back().at;
  }

 private:
  struct Change {
    Instant at{};
    double before = 1;
  };

  std::deque<Change> changes_;
};

}  // namespace porttape
