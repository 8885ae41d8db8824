#include "libport/tape/tape_diff.hpp"

#include <cstdlib>
#include <span>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/tape/turn_pairs.hpp"

namespace porttape {
namespace {

using DiffKind = TapeDifference::Kind;
using Index = TurnPairs::Index;

Result<TurnNotes> read_notes(TapeReader& reader, const std::string& name, const TapeDiffOptions& options,
                             std::uint64_t& bytes, ComparedTape& told) {
  const std::uint64_t before = bytes;
  const auto progress = [&](std::uint64_t here) {
    bytes = before + here;
    if (options.progress) options.progress(bytes);
  };
  TurnReader turns(reader, {.events = options.events, .progress = progress});
  TurnNotes notes;
  for (;;) {
    const Result<const Turn*> turn = turns.next();
    if (!turn) return turn.error();
    if (*turn == nullptr) break;
    if (notes.size() >= TapeDifference::kNone - 1)
      return make_error(Errc::usage, "tape " + in_quotes(name) + " is too long to be compared");
    notes.push_back(note_of(**turn));
    ++(notes.back().is_event ? told.events : told.turns);
  }
  told.exchanges = turns.exchanges();
  told.torn_tail = reader.torn_tail();
  return notes;
}

// Lists the differences of two tapes whose turns are paired.
class DifferenceList {
 public:
  DifferenceList(const TurnNotes& one, const TurnNotes& other, const TurnPairs& pairs,
                 std::optional<Micros> margin, TapeDiff& diff)
      : one_(one),
        other_(other),
        pairs_(pairs),
        crossings_(pairs.crossings()),
        margin_(margin),
        diff_(diff) {}

  void run() {
    Index i = 0;
    Index k = 0;
    while (i < one_.size() || k < other_.size()) {
      if (i < one_.size() && !pairs_.in_order(i)) {
        if (pairs_.is_alone(i)) add({.kind = DiffKind::missing, .one = i});
        if (!one_[i++].is_event) waits_compare_ = false;
      } else if (k < other_.size() && !pairs_.other_in_order(k)) {
        if (pairs_.other_is_alone(k)) add({.kind = DiffKind::added, .other = k});
        list_crossing(k);
        if (!other_[k++].is_event) waits_compare_ = false;
      } else {
        compare(i++, k++);
      }
    }
  }

 private:
  void list_crossing(Index k) {
    if (crossings_.empty() || crossings_.front().other != k) return;
    const auto [other, one, moved] = crossings_.front();
    add({.kind = moved ? DiffKind::moved : DiffKind::changed, .one = one, .other = other, .crosses = true});
    crossings_ = crossings_.subspan(1);
  }

  void compare(Index i, Index k) {
    const TurnNote& mine = one_[i];
    const TurnNote& theirs = other_[k];
    if (mine.digest != theirs.digest) {
      add({.kind = DiffKind::changed, .one = i, .other = k});
    } else if (!mine.is_event) {
      ++diff_.same;
      if (waits_compare_) times(mine.wait_us, theirs.wait_us, TapeDifference::Time::wait, i, k);
      if (mine.answer_us >= 0 && theirs.answer_us >= 0)
        times(mine.answer_us, theirs.answer_us, TapeDifference::Time::answer, i, k);
    }
    if (!mine.is_event) waits_compare_ = true;
  }

  void times(std::int64_t mine, std::int64_t theirs, TapeDifference::Time time, Index i, Index k) {
    if (!margin_ || std::abs(theirs - mine) <= margin_->count()) return;
    add({.kind = theirs > mine ? DiffKind::slower : DiffKind::faster, .time = time, .one = i, .other = k});
  }

  void add(const TapeDifference& difference) {
    diff_.differences.push_back(difference);
    ++diff_.counts.at(static_cast<std::size_t>(difference.kind));
  }

  const TurnNotes& one_;
  const TurnNotes& other_;
  const TurnPairs& pairs_;
  std::span<const TurnPairs::Crossing> crossings_;  // those not listed yet
  std::optional<Micros> margin_;
  TapeDiff& diff_;
  bool waits_compare_ = true;  // what was before is a pair too
};

}  // namespace

std::string_view to_string(TapeDifference::Kind kind) {
  constexpr std::array<std::string_view, kTapeDifferenceKinds> words = {"added", "missing", "changed",
                                                                        "moved", "slower",  "faster"};
  return words.at(static_cast<std::size_t>(kind));
}

Result<TapeDiff> diff_tapes(const TapePaths& one, const TapePaths& other, const TapeDiffOptions& options) {
  Result<TapeReader> first = TapeReader::open(one);
  if (!first) return first.error();
  Result<TapeReader> second = TapeReader::open(other);
  if (!second) return second.error();
  TapeDiff diff;
  diff.one.has_events = first->has_events();
  diff.other.has_events = second->has_events();
  diff.events = options.events && first->has_events() && second->has_events();
  TapeDiffOptions compared = options;
  compared.events = diff.events;
  std::uint64_t bytes = 0;
  const Result<TurnNotes> mine = read_notes(*first, one.name(), compared, bytes, diff.one);
  if (!mine) return mine.error();
  const Result<TurnNotes> theirs = read_notes(*second, other.name(), compared, bytes, diff.other);
  if (!theirs) return theirs.error();
  const TurnPairs pairs(*mine, *theirs);
  DifferenceList(*mine, *theirs, pairs, options.margin, diff).run();
  return diff;
}

}  // namespace porttape
