#include "libport/replay/frame_diff.hpp"

#include <algorithm>

#include "libport/replay/byte_diff.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostAligned = 12;  // frames of each side

// Costs of a line of the comparison; of a change there is a part for how much of the frame is another.
constexpr double kKnown = 0.5;     // left out, or added and known from elsewhere
constexpr double kUnknown = 1.05;  // added, and nowhere else
constexpr double kChanged = 0.7;
constexpr double kChangedWholly = 0.5;

bool starts_with(ByteView bytes, const TapeFrame& frame) {
  return frame.length <= bytes.size() && frame.is(bytes.first(frame.length));
}

// The longest frame of the tape that the bytes begin with.
std::size_t known_length(const TapeExcerpt& excerpt, ByteView bytes) {
  std::size_t longest = 0;
  for (const TapeExcerpt::Step& step : excerpt.steps) {
    if (step.frame.length > longest && starts_with(bytes, step.frame)) longest = step.frame.length;
  }
  return longest;
}

// Where the line ends that the bytes begin with; nothing: nowhere.
std::optional<std::size_t> line_length(ByteView bytes) {
  const auto end = std::ranges::find_if(bytes, is_line_end);
  if (end == bytes.end()) return std::nullopt;
  const auto next = std::find_if_not(end, bytes.end(), is_line_end);
  return static_cast<std::size_t>(next - bytes.begin());
}

std::optional<std::size_t> next_known(const TapeExcerpt& excerpt, ByteView bytes) {
  for (std::size_t at = 1; at < bytes.size(); ++at) {
    if (known_length(excerpt, bytes.subspan(at)) > 1) return at;
  }
  return std::nullopt;
}

bool is_known(const TapeExcerpt& excerpt, const CameFrame& came) {
  return std::ranges::any_of(excerpt.steps,
                             [&came](const TapeExcerpt::Step& step) { return step.frame.is(came.bytes); });
}

class Alignment {
 public:
  Alignment(const TapeExcerpt& excerpt, const std::vector<CameFrame>& came)
      : excerpt_(excerpt),
        came_(came),
        rows_(std::min(excerpt.steps.size() - excerpt.place, kMostAligned)),
        columns_(std::min(came.size(), kMostAligned)),
        cells_((rows_ + 1) * (columns_ + 1)) {
    for (std::size_t row = 0; row <= rows_; ++row) {
      for (std::size_t column = 0; column <= columns_; ++column) at(row, column) = best(row, column);
    }
  }

  [[nodiscard]] std::vector<DiffRow> rows() {
    std::size_t row = 0;
    for (std::size_t other = 1; other <= rows_; ++other) {
      if (at(other, columns_).cost <= at(row, columns_).cost) row = other;
    }
    std::vector<DiffRow> out;
    for (std::size_t column = columns_; row > 0 || column > 0;) {
      const DiffRow::Op op = at(row, column).op;
      DiffRow next{.op = op, .step = std::nullopt, .came = std::nullopt};
      if (op != DiffRow::Op::added) next.step = excerpt_.place + --row;
      if (op != DiffRow::Op::left_out) next.came = came_[--column];
      out.push_back(std::move(next));
    }
    std::ranges::reverse(out);
    return out;
  }

 private:
  struct Cell {
    double cost = 0;
    DiffRow::Op op = DiffRow::Op::same;
  };

  Cell& at(std::size_t row, std::size_t column) { return cells_[row * (columns_ + 1) + column]; }

  Cell best(std::size_t row, std::size_t column) {
    if (row == 0 && column == 0) return {};
    Cell best{1e9, DiffRow::Op::same};
    const auto offer = [&best](double cost, DiffRow::Op op) {
      if (cost < best.cost) best = {cost, op};
    };
    if (row > 0 && column > 0) {
      const double change = changing(excerpt_.steps[excerpt_.place + row - 1].frame, came_[column - 1]);
      offer(at(row - 1, column - 1).cost + change, change > 0 ? DiffRow::Op::changed : DiffRow::Op::same);
    }
    if (column > 0) {
      const double add = is_known(excerpt_, came_[column - 1]) ? kKnown : kUnknown;
      offer(at(row, column - 1).cost + add, DiffRow::Op::added);
    }
    if (row > 0) offer(at(row - 1, column).cost + kKnown, DiffRow::Op::left_out);
    return best;
  }

  static double changing(const TapeFrame& frame, const CameFrame& came) {
    if (frame.is(came.bytes)) return 0;
    const std::vector<ByteEdit> edits = diff_bytes(frame.bytes, came.bytes, came.open_end);
    const std::size_t other = differing(edits);
    if (other == 0 && frame.length == frame.bytes.size()) return came.open_end ? 0 : kChanged;
    return kChanged + kChangedWholly * static_cast<double>(other) / static_cast<double>(edits.size());
  }

  const TapeExcerpt& excerpt_;
  const std::vector<CameFrame>& came_;
  std::size_t rows_;
  std::size_t columns_;
  std::vector<Cell> cells_;
};

}  // namespace

std::vector<CameFrame> cut_came(const TapeExcerpt& excerpt, ByteView came) {
  std::vector<CameFrame> out;
  while (!came.empty()) {
    std::size_t length = known_length(excerpt, came);
    if (length == 0) {
      const auto end = excerpt.lines ? line_length(came) : next_known(excerpt, came);
      length = end.value_or(came.size());
    }
    const ByteView frame = came.first(length);
    const bool last = length == came.size();
    const bool whole = excerpt.lines ? is_line_end(frame.back()) : known_length(excerpt, frame) == length;
    out.push_back({Bytes(frame.begin(), frame.end()), last && !whole});
    came = came.subspan(length);
  }
  return out;
}

bool resembles(const TapeFrame& frame, const CameFrame& came) {
  const std::vector<ByteEdit> edits = diff_bytes(frame.bytes, came.bytes, came.open_end);
  return differing(edits) * 2 <= edits.size();
}

std::vector<DiffRow> align_frames(const TapeExcerpt& excerpt, const std::vector<CameFrame>& came) {
  return Alignment(excerpt, came).rows();
}

}  // namespace porttape
