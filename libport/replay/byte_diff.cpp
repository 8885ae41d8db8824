#include "libport/replay/byte_diff.hpp"

#include <algorithm>
#include <utility>

namespace porttape {
namespace {

// The distances between all beginnings of the two.
class Distances {
 public:
  Distances(ByteView recorded, ByteView came) : recorded_(recorded), came_(came), width_(came.size() + 1) {
    cells_.resize((recorded.size() + 1) * width_);
    for (std::size_t row = 0; row <= recorded.size(); ++row) {
      for (std::size_t column = 0; column < width_; ++column) at(row, column) = distance(row, column);
    }
  }

  [[nodiscard]] std::uint16_t of(std::size_t row, std::size_t column) const {
    return cells_[row * width_ + column];
  }

  // The edits that lead to this cell. Where several are as few, bytes are changed sooner than left out and
  // added.
  [[nodiscard]] std::vector<ByteEdit> edits_to(std::size_t row, std::size_t column) const {
    std::vector<ByteEdit> edits;
    while (row > 0 || column > 0) {
      const std::uint16_t here = of(row, column);
      const bool both = row > 0 && column > 0;
      const int other = both && recorded_[row - 1] != came_[column - 1] ? 1 : 0;
      if (both && here == of(row - 1, column - 1) + other) {
        edits.push_back({recorded_[--row], came_[--column]});
      } else if (column > 0 && here == of(row, column - 1) + 1) {
        edits.push_back({std::nullopt, came_[--column]});
      } else {
        edits.push_back({recorded_[--row], std::nullopt});
      }
    }
    std::ranges::reverse(edits);
    return edits;
  }

 private:
  std::uint16_t& at(std::size_t row, std::size_t column) { return cells_[row * width_ + column]; }

  [[nodiscard]] std::uint16_t distance(std::size_t row, std::size_t column) const {
    if (row == 0 || column == 0) return static_cast<std::uint16_t>(row + column);
    const bool same = recorded_[row - 1] == came_[column - 1];
    const int changed = of(row - 1, column - 1) + (same ? 0 : 1);
    const int left_out = of(row - 1, column) + 1;
    const int added = of(row, column - 1) + 1;
    return static_cast<std::uint16_t>(std::min({changed, left_out, added}));
  }

  ByteView recorded_;
  ByteView came_;
  std::size_t width_;
  std::vector<std::uint16_t> cells_;
};

// A run of bytes that are left out or added goes as far back as it can among equal ones: `VV` with one `V`
// more has it at its end.
void move_back(std::vector<ByteEdit>& edits) {
  const auto is_gap = [](const ByteEdit& edit) { return !edit.recorded || !edit.came; };
  for (std::size_t begin = 0; begin < edits.size(); ++begin) {
    if (!is_gap(edits[begin])) continue;
    const bool added = !edits[begin].recorded;
    std::size_t end = begin + 1;
    while (end < edits.size() && is_gap(edits[end]) && !edits[end].recorded == added) ++end;
    for (; end < edits.size() && edits[end].same(); ++begin, ++end) {
      const std::optional<Byte> byte = added ? edits[begin].came : edits[begin].recorded;
      if (edits[end].came != byte) break;
      std::swap(edits[begin], edits[end]);
    }
    begin = end - 1;
  }
}

}  // namespace

std::vector<ByteEdit> diff_bytes(ByteView recorded, ByteView came, bool open_end) {
  recorded = recorded.first(std::min(recorded.size(), kMostDiffed));
  came = came.first(std::min(came.size(), kMostDiffed));
  const Distances distances(recorded, came);
  std::size_t row = recorded.size();
  // Of equally good beginnings of what is recorded, the one of the length of what came.
  const auto off = [&](std::size_t at) { return at < came.size() ? came.size() - at : at - came.size(); };
  for (std::size_t other = 0; open_end && other < recorded.size(); ++other) {
    const std::uint16_t cost = distances.of(other, came.size());
    const std::uint16_t best = distances.of(row, came.size());
    if (cost < best || (cost == best && off(other) < off(row))) row = other;
  }
  std::vector<ByteEdit> edits = distances.edits_to(row, came.size());
  move_back(edits);
  return edits;
}

std::size_t differing(const std::vector<ByteEdit>& edits) {
  return static_cast<std::size_t>(
      std::ranges::count_if(edits, [](const ByteEdit& edit) { return !edit.same(); }));
}

}  // namespace porttape
