#pragma once

#include <cstdint>
#include <deque>
#include <span>
#include <vector>

#include "libport/tape/sequence_alignment.hpp"
#include "libport/tape/turn_reader.hpp"

namespace porttape {

// What is kept of a turn to compare it.
struct TurnNote {
  std::uint64_t digest = 0;  // of all that matters
  std::int64_t wait_us = 0;
  std::int64_t answer_us = -1;  // -1: none
  std::uint32_t question = 0;   // digest of what was written; of an event: of its kind, and of what it is
  bool is_event = false;
  bool is_place = true;  // all but events, opens and closes: the others stand behind one of them
  bool sampled = false;  // may have been seen a place too early or too late
};
using TurnNotes = std::deque<TurnNote>;  // grows without a copy

TurnNote note_of(const Turn& turn);

// Says which turn of one tape is which of another's. What has a place is paired in order: by all that it
// says, then by its question, then, where as many are left, one by one. Of the other events the order behind
// one place does not matter. Refers to the notes.
class TurnPairs {
 public:
  using Index = std::uint32_t;
  struct Crossing {  // a pair that is in no order, at its place in the other tape
    Index other = 0;
    Index one = 0;
    bool moved = false;  // else it is an event that is changed

    friend auto operator<=>(const Crossing&, const Crossing&) = default;
  };

  TurnPairs(const TurnNotes& one, const TurnNotes& other);

  // Of a turn of the first tape: whether it is in a pair that is in order, with what; or else alone.
  [[nodiscard]] bool in_order(Index one) const { return partners_[one] < kCrossing; }
  [[nodiscard]] bool other_in_order(Index other) const { return others_partners_[other] < kCrossing; }
  [[nodiscard]] bool is_alone(Index one) const { return partners_[one] == kNoPartner; }
  [[nodiscard]] bool other_is_alone(Index other) const { return others_partners_[other] == kNoPartner; }
  // Those that are a difference, by their turn in the other tape.
  [[nodiscard]] std::span<const Crossing> crossings() const { return crossings_; }

 private:
  static constexpr Index kCrossing = kNoPartner - 1;

  struct Gap {  // between two pairs, in places
    std::size_t from = 0;
    std::size_t to = 0;
    std::size_t other_from = 0;
    std::size_t other_to = 0;
  };
  // An event without a pair, with what it must be paired by.
  struct LooseEvent {
    std::uint64_t key = 0;
    std::int64_t place = 0;  // of the first tape: the last in a pair before it; -1: none
    Index turn = 0;

    friend auto operator<=>(const LooseEvent&, const LooseEvent&) = default;
  };

  void pair(Index one, Index other) {
    partners_[one] = other;
    others_partners_[other] = one;
  }
  void cross(Index one, Index other, bool moved, bool differs);
  // One side of the comparison, and the other one seen from there.
  struct Side {
    const TurnNotes& notes;
    const std::vector<Index>& places;
    std::vector<Index>& partners;
    const std::vector<Index>& others_places;
    std::vector<Index>& others_partners;
  };

  void pair_all();
  static void slide(Side side);
  static bool alone_beside(Side side, Index other, int step);
  static bool slide_from(Side side, std::size_t from, int step);
  void in_gaps(const auto& visit);
  void pair_questions(const Gap& gap);
  void pair_moved();
  void pair_rest(const Gap& gap);
  void pair_events();
  void pair_loose(const auto& key, const auto& others_key, std::int64_t shift, bool placed, bool changed);
  [[nodiscard]] std::vector<LooseEvent> loose_events(bool of_other, const auto& key, std::int64_t shift,
                                                     bool placed) const;

  const TurnNotes& one_;
  const TurnNotes& other_;
  AlignmentEffort effort_;
  std::vector<Index> places_;  // the turns that have one
  std::vector<Index> other_places_;
  std::vector<Index> partners_;  // of each turn
  std::vector<Index> others_partners_;
  std::vector<Crossing> crossings_;
};

}  // namespace porttape
