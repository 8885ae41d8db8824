#include "libport/infer/align.hpp"

#include <algorithm>
#include <cstdint>
#include <stdexcept>

namespace porttape {
namespace {

// Likenesses are added as whole numbers, so that sums that are as good are seen to be.
constexpr std::int64_t kLike = std::int64_t{1} << 30;

enum class Move : std::uint8_t { both, a_alone, b_alone };

class Table {
 public:
  Table(std::size_t a_size, std::size_t b_size) : width_(b_size + 1), moves_((a_size + 1) * width_) {}
  Move& at(std::size_t a, std::size_t b) { return moves_[a * width_ + b]; }

 private:
  std::size_t width_;
  std::vector<Move> moves_;
};

// Filled from the ends, so that walking it from the front prefers to put items together early.
void fill(Table& table, std::size_t a_size, std::size_t b_size, const Likeness& likeness) {
  std::vector<std::int64_t> below(b_size + 1);  // the best sum from (a + 1, b) on
  for (std::size_t b = 0; b <= b_size; ++b) {
    table.at(a_size, b) = Move::b_alone;
  }
  std::vector<std::int64_t> row(b_size + 1);
  for (std::size_t a = a_size; a-- > 0;) {
    table.at(a, b_size) = Move::a_alone;
    for (std::size_t b = b_size; b-- > 0;) {
      const auto like = static_cast<std::int64_t>(static_cast<double>(kLike) * likeness(a, b));
      std::int64_t best = below[b];
      Move move = Move::a_alone;
      if (row[b + 1] > best) {
        best = row[b + 1];
        move = Move::b_alone;
      }
      if (like > 0 && below[b + 1] + like >= best) {
        best = below[b + 1] + like;
        move = Move::both;
      }
      row[b] = best;
      table.at(a, b) = move;
    }
    std::swap(row, below);
  }
}

}  // namespace

std::vector<AlignedPair> align(std::size_t a_size, std::size_t b_size, const Likeness& likeness) {
  if ((a_size + 1) > kMostCells / (b_size + 1)) throw std::length_error("sequences too long to align");
  Table table(a_size, b_size);
  fill(table, a_size, b_size, likeness);
  std::vector<AlignedPair> pairs;
  for (std::size_t a = 0, b = 0; a < a_size || b < b_size;) {
    const Move move = table.at(a, b);
    AlignedPair pair;
    if (move != Move::b_alone) pair.a = a++;
    if (move != Move::a_alone) pair.b = b++;
    pairs.push_back(pair);
  }
  return pairs;
}

std::vector<Column> align_all(std::span<const std::size_t> sizes, const LikenessOf& likeness) {
  std::vector<Column> columns;
  for (std::size_t of = 0; of < sizes.size(); ++of) {
    const auto like = [&](std::size_t column, std::size_t item) {
      double best = 0;
      for (std::size_t other = 0; other < of; ++other) {
        const auto& known = columns[column][other];
        if (known) best = std::max(best, likeness(other, *known, of, item));
      }
      return best;
    };
    std::vector<Column> joined;
    for (const AlignedPair& pair : align(columns.size(), sizes[of], like)) {
      Column column = pair.a ? std::move(columns[*pair.a]) : Column(of);
      column.push_back(pair.b);
      joined.push_back(std::move(column));
    }
    columns = std::move(joined);
  }
  return columns;
}

}  // namespace porttape
