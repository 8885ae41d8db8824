#include "libport/tape/sequence_alignment.hpp"

#include <algorithm>
#include <utility>

namespace porttape {
namespace {

using Elements = std::span<const std::uint64_t>;
using Index = std::uint32_t;

constexpr int kTriedEdits = 1024;    // differences of a range that are looked for at most before it is split
constexpr int kForcedEdits = 256;    // … until something is paired where it cannot be split
constexpr int kTiredEdits = 16;      // the same, once the effort is used up
constexpr unsigned kMostSplits = 8;  // of a range in a range
constexpr std::size_t kFewAnchors = 4;

// Of one sequence those that the other has too, with their places.
struct Shared {
  std::vector<std::uint64_t> values;
  std::vector<Index> places;
};

Shared shared_with(Elements these, Elements others) {
  std::vector<std::uint64_t> sorted(others.begin(), others.end());
  std::sort(sorted.begin(), sorted.end());
  Shared shared;
  for (Index i = 0; i < these.size(); ++i) {
    if (!std::binary_search(sorted.begin(), sorted.end(), these[i])) continue;
    shared.values.push_back(these[i]);
    shared.places.push_back(i);
  }
  return shared;
}

struct AlignedRange {
  Index from = 0;
  Index to = 0;
  Index other_from = 0;
  Index other_to = 0;
  unsigned splits = 0;

  [[nodiscard]] int size() const { return static_cast<int>(to - from); }
  [[nodiscard]] int other_size() const { return static_cast<int>(other_to - other_from); }
};

struct AlignedPair {
  Index one = 0;
  Index other = 0;
};

// Myers' greedy search in one range: how far each diagonal is reached with so many differences.
class EditSearch {
 public:
  EditSearch(Elements one, Elements other, AlignmentEffort& effort)
      : one_(one),
        other_(other),
        size_(static_cast<int>(one.size())),
        other_size_(static_cast<int>(other.size())),
        effort_(effort) {}

  enum class Tired : std::uint8_t { gives_up, goes_on };
  // Whether the end is reached with at most so many differences, and before the effort is used up.
  bool reach_end(int most, Tired tired) {
    for (edits_ = 0;; ++edits_) {
      if (advance()) return true;
      if (edits_ >= most || (effort_.steps == 0 && tired == Tired::gives_up)) return false;
    }
  }

  // Walks back from the end, or from where most was reached; gives that place.
  AlignedPair walk_back(bool from_end, const auto& pair) const {
    int diagonal = from_end ? size_ - other_size_ : best_diagonal();
    const AlignedPair reached = place(reach(edits_, diagonal), diagonal);
    int x = reach(edits_, diagonal);
    for (int d = edits_; d > 0; --d) {
      const int before = previous(d, diagonal);
      const int start = reach(d - 1, before) + (before < diagonal ? 1 : 0);
      for (; x > start; --x) pair(place(x - 1, diagonal));
      x = reach(d - 1, before);
      diagonal = before;
    }
    for (; x > 0; --x) pair(place(x - 1, diagonal));
    return reached;
  }

 private:
  static constexpr int kNowhere = -1;

  // Diagonal k of the row of d edits: one row has d + 1 of them, two apart.
  [[nodiscard]] static std::size_t cell(int d, int k) {
    const auto row = static_cast<std::size_t>(d);
    return row * (row + 1) / 2 + static_cast<std::size_t>((k + d) / 2);
  }
  [[nodiscard]] int reach(int d, int k) const { return k < -d || k > d ? kNowhere : reached_[cell(d, k)]; }
  static AlignedPair place(int x, int diagonal) {
    return {static_cast<Index>(x), static_cast<Index>(x - diagonal)};
  }

  // From which diagonal of d - 1 edits one with d is reached.
  [[nodiscard]] int previous(int d, int k) const {
    return step_right(d, k) > reach_down(d, k) ? k - 1 : k + 1;
  }
  [[nodiscard]] int limit(int k) const { return std::min(size_, other_size_ + k); }
  [[nodiscard]] int step_right(int d, int k) const {
    const int from = reach(d - 1, k - 1);
    return from == kNowhere || from + 1 > limit(k) ? kNowhere : from + 1;
  }
  [[nodiscard]] int reach_down(int d, int k) const {
    const int from = reach(d - 1, k + 1);
    return from == kNowhere || from > limit(k) ? kNowhere : from;
  }

  // The row of edits_; whether it reaches the end.
  bool advance() {
    const int d = edits_;
    reached_.resize(cell(d, d) + 1, kNowhere);
    for (int k = -d; k <= d; k += 2) {
      int x = d == 0 ? 0 : std::max(step_right(d, k), reach_down(d, k));
      if (x == kNowhere) continue;
      const int begin = x;
      const int end = limit(k);
      while (x < end && one_[static_cast<std::size_t>(x)] == other_[static_cast<std::size_t>(x - k)]) ++x;
      reached_[cell(d, k)] = x;
      effort_.steps -= std::min(effort_.steps, static_cast<std::uint64_t>(x - begin + 1));
      if (x == size_ && x - k == other_size_) return true;
    }
    return false;
  }

  [[nodiscard]] int best_diagonal() const {
    int best = -edits_;
    int most = -1;
    for (int k = -edits_; k <= edits_; k += 2) {
      const int x = reach(edits_, k);
      if (x == kNowhere || 2 * x - k <= most) continue;
      most = 2 * x - k;
      best = k;
    }
    return best;
  }

  Elements one_;
  Elements other_;
  int size_;
  int other_size_;
  AlignmentEffort& effort_;
  int edits_ = 0;
  std::vector<int> reached_;
};

// What is once in both, in the order of the first sequence.
std::vector<AlignedPair> unique_pairs(Elements one, Elements other) {
  struct Entry {
    std::uint64_t value;
    Index index;
    bool in_other;
  };
  std::vector<Entry> entries;
  entries.reserve(one.size() + other.size());
  for (Index i = 0; i < one.size(); ++i) entries.push_back({one[i], i, false});
  for (Index i = 0; i < other.size(); ++i) entries.push_back({other[i], i, true});
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return a.value != b.value ? a.value < b.value : a.in_other < b.in_other;
  });
  std::vector<AlignedPair> pairs;
  for (auto first = entries.begin(); first != entries.end();) {
    const auto second = first + 1;
    const auto end = std::find_if(second, entries.end(),
                                  [&first](const Entry& entry) { return entry.value != first->value; });
    if (end - first == 2 && !first->in_other && second->in_other)
      pairs.push_back({first->index, second->index});
    first = end;
  }
  std::sort(pairs.begin(), pairs.end(),
            [](const AlignedPair& a, const AlignedPair& b) { return a.one < b.one; });
  return pairs;
}

// The most of them that ascend in both.
std::vector<AlignedPair> longest_chain(const std::vector<AlignedPair>& pairs) {
  std::vector<std::size_t> ends;  // of the chains of each length, the one that ends lowest
  std::vector<std::size_t> before(pairs.size());
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const auto at = std::lower_bound(ends.begin(), ends.end(), i, [&](std::size_t end, std::size_t mine) {
      return pairs[end].other < pairs[mine].other;
    });
    before[i] = at == ends.begin() ? i : *(at - 1);
    if (at == ends.end()) {
      ends.push_back(i);
    } else {
      *at = i;
    }
  }
  std::vector<AlignedPair> chain(ends.size());
  std::size_t i = ends.empty() ? 0 : ends.back();
  for (std::size_t n = chain.size(); n-- > 0; i = before[i]) chain[n] = pairs[i];
  return chain;
}

class SequenceAligner {
 public:
  SequenceAligner(Elements one, Elements other, AlignmentEffort& effort, HardRanges hard)
      : one_(one), other_(other), effort_(effort), hard_(hard), partners_(one.size(), kNoPartner) {}

  std::vector<Index> run() {
    ranges_.push_back({0, static_cast<Index>(one_.size()), 0, static_cast<Index>(other_.size())});
    while (!ranges_.empty()) {
      const AlignedRange range = trimmed(ranges_.back());
      ranges_.pop_back();
      if (range.size() > 0 && range.other_size() > 0) align(range);
    }
    return std::move(partners_);
  }

 private:
  void pair(Index one, Index other) { partners_[one] = other; }

  AlignedRange trimmed(AlignedRange range) {
    while (range.size() > 0 && range.other_size() > 0 && one_[range.from] == other_[range.other_from])
      pair(range.from++, range.other_from++);
    while (range.size() > 0 && range.other_size() > 0 && one_[range.to - 1] == other_[range.other_to - 1])
      pair(--range.to, --range.other_to);
    return range;
  }

  [[nodiscard]] EditSearch search_in(const AlignedRange& range) {
    return {one_.subspan(range.from, range.to - range.from),
            other_.subspan(range.other_from, range.other_to - range.other_from), effort_};
  }
  AlignedPair take(const AlignedRange& range, const EditSearch& search, bool from_end) {
    return search.walk_back(from_end, [&](const AlignedPair& found) {
      pair(range.from + found.one, range.other_from + found.other);
    });
  }

  void align(const AlignedRange& range) {
    if (effort_.steps > 0) {
      EditSearch search = search_in(range);
      if (search.reach_end(kTriedEdits, EditSearch::Tired::gives_up)) {
        take(range, search, true);
        return;
      }
    }
    if (range.splits < kMostSplits && split(range)) return;
    if (hard_ == HardRanges::aligned) force(range);
  }

  // At what is unique in both, where most of it is in the same order.
  bool split(const AlignedRange& range) {
    const std::vector<AlignedPair> unique =
        unique_pairs(one_.subspan(range.from, range.to - range.from),
                     other_.subspan(range.other_from, range.other_to - range.other_from));
    const std::vector<AlignedPair> chain = longest_chain(unique);
    if (chain.size() < kFewAnchors || chain.size() < unique.size() / 2) return false;
    AlignedRange part{range.from, range.from, range.other_from, range.other_from, range.splits + 1};
    for (const AlignedPair& anchor : chain) {
      part.to = range.from + anchor.one;
      part.other_to = range.other_from + anchor.other;
      pair(part.to, part.other_to);
      ranges_.push_back(part);
      part.from = part.to + 1;
      part.other_from = part.other_to + 1;
    }
    part.to = range.to;
    part.other_to = range.other_to;
    ranges_.push_back(part);
    return true;
  }

  // From its begin on, always as far as so many differences lead.
  void force(AlignedRange range) {
    while (range.size() > 0 && range.other_size() > 0) {
      const int most = effort_.steps > 0 ? kForcedEdits : kTiredEdits;
      EditSearch search = search_in(range);
      const bool at_end = search.reach_end(most, EditSearch::Tired::goes_on);
      const AlignedPair reached = take(range, search, at_end);
      if (at_end) return;
      range.from += reached.one;
      range.other_from += reached.other;
    }
  }

  Elements one_;
  Elements other_;
  AlignmentEffort& effort_;
  HardRanges hard_;
  std::vector<Index> partners_;
  std::vector<AlignedRange> ranges_;
};

}  // namespace

std::vector<std::uint32_t> align_sequences(Elements one, Elements other, AlignmentEffort& effort,
                                           HardRanges hard) {
  std::vector<Index> partners(one.size(), kNoPartner);
  if (one.empty() || other.empty()) return partners;
  const Shared mine = shared_with(one, other);
  const Shared theirs = shared_with(other, one);
  const std::vector<Index> found = SequenceAligner(mine.values, theirs.values, effort, hard).run();
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (found[i] != kNoPartner) partners[mine.places[i]] = theirs.places[found[i]];
  }
  return partners;
}

}  // namespace porttape
