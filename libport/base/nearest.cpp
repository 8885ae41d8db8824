#include "libport/base/nearest.hpp"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "libport/base/printable.hpp"

namespace porttape {
namespace {

// More is no word of ours, and would take long.
constexpr std::size_t kLongest = 64;

char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

std::string lower(std::string_view word) {
  std::string text(word);
  std::ranges::transform(text, text.begin(), [](char c) { return lower(c); });
  return text;
}

// Row by row: what it takes to make the first n letters of `right` of the first letters of `left`.
std::size_t distance(std::string_view left, std::string_view right) {
  std::vector<std::size_t> before(right.size() + 1);
  std::vector<std::size_t> last(right.size() + 1);
  std::vector<std::size_t> row(right.size() + 1);
  for (std::size_t n = 0; n < row.size(); ++n) row[n] = n;
  for (std::size_t l = 1; l <= left.size(); ++l) {
    before = std::exchange(last, row);
    row[0] = l;
    for (std::size_t r = 1; r <= right.size(); ++r) {
      const std::size_t other = left[l - 1] == right[r - 1] ? 0 : 1;
      row[r] = std::min({last[r] + 1, row[r - 1] + 1, last[r - 1] + other});
      const bool swapped = l > 1 && r > 1 && left[l - 1] == right[r - 2] && left[l - 2] == right[r - 1];
      if (swapped) row[r] = std::min(row[r], before[r - 2] + 1);
    }
  }
  return row.back();
}

std::size_t most_wrong(std::size_t letters) { return letters <= 4 ? 1 : letters <= 8 ? 2 : 3; }

std::optional<std::string_view> only_beginning(const std::string& word,
                                               std::span<const std::string_view> known) {
  const auto begins = [&](std::string_view each) { return lower(each).starts_with(word); };
  if (word.size() < 3 || std::ranges::count_if(known, begins) != 1) return std::nullopt;
  return *std::ranges::find_if(known, begins);
}

}  // namespace

std::optional<std::string_view> nearest(std::string_view word, std::span<const std::string_view> known) {
  if (word.empty() || word.size() > kLongest) return std::nullopt;
  const std::string typed = lower(word);
  std::optional<std::string_view> best;
  // In a word of one letter everything would be wrong.
  std::size_t least = std::min(most_wrong(typed.size()) + 1, typed.size());
  for (const std::string_view each : known) {
    const std::size_t wrong = distance(typed, lower(each));
    if (wrong >= least) continue;
    least = wrong;
    best = each;
  }
  return best ? best : only_beginning(typed, known);
}

std::string did_you_mean(std::string_view word, std::span<const std::string_view> known) {
  const auto best = nearest(word, known);
  return best ? "; did you mean " + in_quotes(*best) + "?" : std::string();
}

}  // namespace porttape
