#include "libport/tape/difference_reader.hpp"

#include <algorithm>
#include <utility>

namespace porttape {

DifferenceReader::Lookup::Lookup(TapeReader reader, bool events)
    : tape_(std::make_unique<TapeReader>(std::move(reader))),
      turns_(std::make_unique<TurnReader>(*tape_, TurnReader::Options{.events = events})) {}

Result<DifferenceReader::Lookup> DifferenceReader::Lookup::open(const TapePaths& tape, bool events) {
  // It has been read through before.
  Result<TapeReader> reader = TapeReader::open(tape, {.checks_end = false});
  if (!reader) return reader.error();
  return Lookup(std::move(*reader), events);
}

Result<const Turn*> DifferenceReader::Lookup::at(std::uint32_t number) {
  while (turns_->count() <= number) {
    const Result<const Turn*> next = turns_->next();
    if (!next) return next.error();
    if (*next == nullptr)
      return make_error(Errc::io, "a tape has changed while it was compared; compare again");
    turn_ = *next;
  }
  return turn_;
}

Result<DifferenceReader> DifferenceReader::open(const TapePaths& one, const TapePaths& other,
                                                std::span<const TapeDifference> differences,
                                                const Options& options) {
  Result<Lookup> mine = Lookup::open(one, options.events);
  if (!mine) return mine.error();
  Result<Lookup> theirs = Lookup::open(other, options.events);
  if (!theirs) return theirs.error();
  const auto most = static_cast<std::size_t>(std::min<std::uint64_t>(options.most, differences.size()));
  DifferenceReader reader(std::move(*mine), std::move(*theirs), differences.first(most));
  if (const auto found = reader.find_crossings(one, options.events); !found) return found.error();
  return reader;
}

// They are asked for in the order of the other tape.
Result<void> DifferenceReader::find_crossings(const TapePaths& one, bool events) {
  for (const TapeDifference& each : differences_) {
    if (each.crosses) crossings_.push_back({each.one, {}});
  }
  if (crossings_.empty()) return {};
  std::sort(crossings_.begin(), crossings_.end(),
            [](const CrossingTurn& a, const CrossingTurn& b) { return a.number < b.number; });
  Result<Lookup> lookup = Lookup::open(one, events);
  if (!lookup) return lookup.error();
  for (CrossingTurn& each : crossings_) {
    const Result<const Turn*> turn = lookup->at(each.number);
    if (!turn) return turn.error();
    each.turn = **turn;
    each.turn.writes = {};
    each.turn.reads = {};
  }
  return {};
}

// Its bytes are the other's.
const Turn* DifferenceReader::crossing_turn(std::uint32_t number, const Turn& other) {
  const auto found =
      std::lower_bound(crossings_.begin(), crossings_.end(), number,
                       [](const CrossingTurn& each, std::uint32_t wanted) { return each.number < wanted; });
  given_ = found->turn;
  given_.writes = other.writes;
  given_.reads = other.reads;
  return &given_;
}

Result<ShownDifference> DifferenceReader::next() {
  ShownDifference shown{.what = differences_.front()};
  differences_ = differences_.subspan(1);
  if (shown.what.other != TapeDifference::kNone) {
    const Result<const Turn*> turn = other_.at(shown.what.other);
    if (!turn) return turn.error();
    shown.other = *turn;
  }
  if (shown.what.crosses) {
    shown.one = crossing_turn(shown.what.one, *shown.other);
  } else if (shown.what.one != TapeDifference::kNone) {
    const Result<const Turn*> turn = one_.at(shown.what.one);
    if (!turn) return turn.error();
    shown.one = *turn;
  }
  return shown;
}

}  // namespace porttape
