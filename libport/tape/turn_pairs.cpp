#include "libport/tape/turn_pairs.hpp"

#include <algorithm>
#include <utility>

namespace porttape {
namespace {

using Index = TurnPairs::Index;

std::vector<Index> places_in(const TurnNotes& notes) {
  std::vector<Index> places;
  places.reserve(notes.size());
  for (Index i = 0; i < notes.size(); ++i) {
    if (notes[i].is_place) places.push_back(i);
  }
  return places;
}

std::vector<std::uint64_t> values_of(const TurnNotes& notes, std::span<const Index> turns,
                                     const auto& value) {
  std::vector<std::uint64_t> values;
  values.reserve(turns.size());
  for (const Index turn : turns) values.push_back(value(notes[turn]));
  return values;
}

std::uint64_t question_of(const TurnNote& note) {
  return std::uint64_t{note.question} << 1U | (note.is_event ? 1U : 0U);
}

}  // namespace

TurnPairs::TurnPairs(const TurnNotes& one, const TurnNotes& other)
    : one_(one),
      other_(other),
      places_(places_in(one)),
      other_places_(places_in(other)),
      partners_(one.size(), kNoPartner),
      others_partners_(other.size(), kNoPartner) {
  pair_all();
  slide({one_, places_, partners_, other_places_, others_partners_});
  slide({other_, other_places_, others_partners_, places_, partners_});
  in_gaps([&](const Gap& gap) { pair_questions(gap); });
  pair_moved();
  in_gaps([&](const Gap& gap) { pair_rest(gap); });
  pair_events();
  std::sort(crossings_.begin(), crossings_.end());
}

void TurnPairs::cross(Index one, Index other, bool moved, bool differs) {
  partners_[one] = others_partners_[other] = kCrossing;
  if (differs) crossings_.push_back({other, one, moved});
}

void TurnPairs::pair_all() {
  const auto digest = [](const TurnNote& note) { return note.digest; };
  const std::vector<Index> found = align_sequences(
      values_of(one_, places_, digest), values_of(other_, other_places_, digest), effort_, HardRanges::left);
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (found[i] != kNoPartner) pair(places_[i], other_places_[found[i]]);
  }
}

// Which of several equal turns has no partner is not to be told: the one beside a turn without a partner on
// the other tape, so that the two are one that is changed.
void TurnPairs::slide(Side side) {
  const auto beside = [&](std::size_t at, int step) {
    const Index partner = at < side.places.size() ? side.partners[side.places[at]] : kNoPartner;
    return partner < kCrossing && alone_beside(side, partner, step);
  };
  for (std::size_t at = 0; at < side.places.size(); ++at) {
    if (side.partners[side.places[at]] != kNoPartner || beside(at - 1, 1) || beside(at + 1, -1)) continue;
    if (!slide_from(side, at, -1)) slide_from(side, at, 1);
  }
}

// Whether the place before or behind that turn of the other tape has no partner.
bool TurnPairs::alone_beside(Side side, Index other, int step) {
  const auto found = std::lower_bound(side.others_places.begin(), side.others_places.end(), other);
  const auto index = static_cast<std::size_t>(found - side.others_places.begin());
  if (step < 0 ? index == 0 : index + 1 == side.others_places.size()) return false;
  return side.others_partners[side.others_places[step < 0 ? index - 1 : index + 1]] == kNoPartner;
}

bool TurnPairs::slide_from(Side side, std::size_t from, int step) {
  constexpr std::size_t kFarthest = 256;
  const auto next = [&](std::size_t at) { return step < 0 ? at - 1 : at + 1; };
  const std::uint64_t digest = side.notes[side.places[from]].digest;
  for (std::size_t at = from, steps = 0; steps < kFarthest; ++steps) {
    if (step < 0 ? at == 0 : at + 1 == side.places.size()) return false;
    at = next(at);
    const Index turn = side.places[at];
    if (side.partners[turn] >= kCrossing || side.notes[turn].digest != digest) return false;
    if (!alone_beside(side, side.partners[turn], step)) continue;
    for (std::size_t to = from; to != at; to = next(to)) {
      const Index partner = side.partners[side.places[next(to)]];
      side.partners[side.places[to]] = partner;
      side.others_partners[partner] = side.places[to];
    }
    side.partners[turn] = kNoPartner;
    return true;
  }
  return false;
}

// What stands between the same two pairs on both tapes.
void TurnPairs::in_gaps(const auto& visit) {
  Gap gap;
  std::size_t k = 0;  // in the other tape's places
  for (std::size_t i = 0; i <= places_.size(); ++i) {
    const bool at_end = i == places_.size();
    if (!at_end && !in_order(places_[i])) continue;
    while (k < other_places_.size() && (at_end || other_places_[k] != partners_[places_[i]])) ++k;
    gap.to = i;
    gap.other_to = k++;
    if (gap.from < gap.to && gap.other_from < gap.other_to) visit(gap);
    gap.from = i + 1;
    gap.other_from = k;
  }
}

void TurnPairs::pair_questions(const Gap& gap) {
  const auto mine = std::span(places_).subspan(gap.from, gap.to - gap.from);
  const auto theirs = std::span(other_places_).subspan(gap.other_from, gap.other_to - gap.other_from);
  const std::vector<Index> found =
      align_sequences(values_of(one_, mine, question_of), values_of(other_, theirs, question_of), effort_);
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (found[i] != kNoPartner) pair(mine[i], theirs[found[i]]);
  }
}

// What is left of both and says the same was moved.
void TurnPairs::pair_moved() {
  using Left = std::vector<std::pair<std::uint64_t, Index>>;
  const auto left = [](const TurnNotes& notes, std::span<const Index> places,
                       const std::vector<Index>& partners) {
    Left all;
    for (const Index turn : places) {
      if (partners[turn] == kNoPartner) all.emplace_back(notes[turn].digest, turn);
    }
    std::sort(all.begin(), all.end());
    return all;
  };
  const Left mine = left(one_, places_, partners_);
  const Left theirs = left(other_, other_places_, others_partners_);
  for (std::size_t i = 0, k = 0; i < mine.size() && k < theirs.size();) {
    if (mine[i].first == theirs[k].first) {
      cross(mine[i++].second, theirs[k++].second, true, true);
    } else {
      ++(mine[i].first < theirs[k].first ? i : k);
    }
  }
}

// What is left in one place of both, but events.
void TurnPairs::pair_rest(const Gap& gap) {
  std::size_t k = gap.other_from;
  for (std::size_t i = gap.from; i < gap.to; ++i) {
    if (!is_alone(places_[i]) || one_[places_[i]].is_event) continue;
    while (k < gap.other_to && (!other_is_alone(other_places_[k]) || other_[other_places_[k]].is_event)) ++k;
    if (k == gap.other_to) return;
    pair(places_[i], other_places_[k++]);
  }
}

void TurnPairs::pair_events() {
  const auto digest = [](const TurnNote& note) { return note.digest; };
  const auto sampled = [](const TurnNote& note) { return note.sampled ? note.digest : 0; };
  pair_loose(digest, digest, 0, true, false);
  for (const std::int64_t shift : {-1, 1}) {
    pair_loose(sampled, digest, shift, true, false);
    pair_loose(digest, sampled, shift, true, false);
  }
  pair_loose(question_of, question_of, 0, true, true);
  pair_loose(digest, digest, 0, false, false);
}

// Pairs events with equal keys, that of the first tape and that of the other: behind the same place, or so
// many further in the first tape; else anywhere, which is to be moved. A key of 0 is none.
void TurnPairs::pair_loose(const auto& key, const auto& others_key, std::int64_t shift, bool placed,
                           bool changed) {
  const std::vector<LooseEvent> mine = loose_events(false, key, shift, placed);
  const std::vector<LooseEvent> theirs = loose_events(true, others_key, 0, placed);
  const auto what = [](const LooseEvent& loose) { return std::pair(loose.key, loose.place); };
  for (std::size_t i = 0, k = 0; i < mine.size() && k < theirs.size();) {
    if (what(mine[i]) == what(theirs[k])) {
      cross(mine[i++].turn, theirs[k++].turn, !placed, !placed || changed);
    } else {
      ++(what(mine[i]) < what(theirs[k]) ? i : k);
    }
  }
}

std::vector<TurnPairs::LooseEvent> TurnPairs::loose_events(bool of_other, const auto& key, std::int64_t shift,
                                                           bool placed) const {
  const TurnNotes& notes = of_other ? other_ : one_;
  const std::vector<Index>& partners = of_other ? others_partners_ : partners_;
  std::vector<LooseEvent> loose;
  std::int64_t pairs = 0;  // in order so far: the same number on both tapes
  for (Index i = 0; i < notes.size(); ++i) {
    if (partners[i] < kCrossing) ++pairs;
    if (partners[i] != kNoPartner || notes[i].is_place) continue;
    if (const std::uint64_t by = key(notes[i]); by != 0) loose.push_back({by, placed ? pairs + shift : 0, i});
  }
  std::sort(loose.begin(), loose.end());
  return loose;
}

}  // namespace porttape
