#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>

#include "libport/replay/expectation.hpp"

namespace porttape {

// Which stretches of the tape's stream of writes the driver left out, as an expectation lets it. Bounded: the
// oldest are forgotten. A plain value.
class LeftOuts {
 public:
  using Kind = Expectation::LeftOut;
  static constexpr std::size_t kMost = 4096;

  void clear() { stretches_.clear(); }
  // In rising order.
  void note(std::uint64_t from, std::uint64_t to, Kind kind) {
    if (kind == Kind::no || from == to) return;
    if (!stretches_.empty() && stretches_.back().to == from && stretches_.back().kind == kind) {
      stretches_.back().to = to;
      return;
    }
    stretches_.push_back({from, to, kind});
    if (stretches_.size() > kMost) stretches_.pop_front();
  }
  // Whether all of it was left out; of the kinds in it what is known least. Ask in rising order.
  [[nodiscard]] Kind of(std::uint64_t from, std::uint64_t to) {
    while (!stretches_.empty() && stretches_.front().to <= from) stretches_.pop_front();
    Kind kind = Kind::no;
    for (auto stretch = stretches_.begin(); from < to; ++stretch) {
      if (stretch == stretches_.end() || stretch->from > from) return Kind::no;
      kind = kind == Kind::no || kind == stretch->kind ? stretch->kind : Kind::not_known;
      from = stretch->to;
    }
    return kind;
  }

 private:
  struct Stretch {
    std::uint64_t from = 0;
    std::uint64_t to = 0;
    Kind kind = Kind::no;
  };
  std::deque<Stretch> stretches_;
};

}  // namespace porttape
