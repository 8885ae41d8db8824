#include "tools/shrinker.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

namespace porttape {
namespace {

// Exchanges to which faults are moved, from the first one on: all of the first few, then fewer.
constexpr std::size_t kNear = 6;

LineDir dir_of(const Fault& fault) { return fault.dir.value_or(LineDir::r); }
bool has_place(const Fault& fault) { return fault.when == Fault::When::byte; }

std::string key_of(const ShrinkCase& one) {
  std::string key;
  for (const std::size_t part : one.parts) key += std::to_string(part) + ' ';
  return key + FaultPlan{one.faults}.text();
}

}  // namespace

std::uint64_t begin_of(const RequestTracker::Turn& turn, LineDir dir) {
  return dir == LineDir::r ? turn.read : turn.written;
}

Shrinker::Shrinker(ShrinkCase failing, TryAll try_all, std::function<bool()> stopped)
    : best_(std::move(failing)), try_all_(std::move(try_all)), stopped_(std::move(stopped)) {
  tried_.insert(key_of(best_));
}

const ShrinkCase& Shrinker::run() {
  cut_behind_failure();
  for (bool smaller = true; smaller && !stopped_();) {
    smaller = drop_faults();
    smaller = move_to_beginning() || smaller;
    smaller = drop_parts() || smaller;
    smaller = simplify_faults() || smaller;
  }
  return best_;
}

bool Shrinker::take_first_of(std::vector<ShrinkCase> cases) {
  std::erase_if(cases, [this](const ShrinkCase& one) {
    return one.parts.empty() || one.faults.empty() || !tried_.insert(key_of(one)).second;
  });
  if (cases.empty() || stopped_()) return false;
  const std::optional<std::size_t> found = try_all_(cases);
  if (!found) return false;
  best_ = std::move(cases[*found]);
  return true;
}

// The last turn that begins where the byte is, or before.
std::optional<std::size_t> Shrinker::turn_of(const Fault& fault) const {
  std::optional<std::size_t> found;
  for (std::size_t turn = 0; turn < best_.end.turns.size(); ++turn) {
    if (begin_of(best_.end.turns[turn], dir_of(fault)) <= fault.position) found = turn;
  }
  return found;
}

// Of a turn that another one follows.
std::uint64_t Shrinker::length(std::size_t turn, LineDir dir) const {
  const auto& turns = best_.end.turns;
  if (turn + 1 >= turns.size()) return 0;
  return begin_of(turns[turn + 1], dir) - begin_of(turns[turn], dir);
}

// The driver came no further.
bool Shrinker::cut_behind_failure() {
  const std::size_t reached = std::min(best_.end.reach, best_.parts.size());
  if (reached == 0 || reached == best_.parts.size()) return false;
  ShrinkCase cut{{best_.parts.begin(), best_.parts.begin() + static_cast<std::ptrdiff_t>(reached)},
                 best_.faults};
  return take_first_of({std::move(cut)});
}

// Without `count` faults from the first on. What a driver asked again because of them it may ask no more, and
// then the bytes behind come sooner.
std::vector<ShrinkCase> Shrinker::without_fault(std::size_t first, std::size_t count) const {
  ShrinkCase fewer{best_.parts, best_.faults};
  const auto begin = fewer.faults.begin() + static_cast<std::ptrdiff_t>(first);
  fewer.faults.erase(begin, begin + static_cast<std::ptrdiff_t>(count));
  ShrinkCase sooner = fewer;
  const auto& turns = best_.end.turns;
  for (Fault& fault : sooner.faults) {
    const std::optional<std::size_t> last = has_place(fault) ? turn_of(fault) : std::nullopt;
    std::uint64_t again = 0;
    for (std::size_t turn = 0; last && turn < *last; ++turn) {
      const bool repeated = turns[turn + 1].part <= turns[turn].part;
      const bool of_dropped =
          std::any_of(best_.faults.begin() + static_cast<std::ptrdiff_t>(first),
                      best_.faults.begin() + static_cast<std::ptrdiff_t>(first + count),
                      [&](const Fault& dropped) { return has_place(dropped) && turn_of(dropped) == turn; });
      if (repeated && of_dropped) again += length(turn, dir_of(fault));
    }
    fault.position -= std::min(again, fault.position);
  }
  return {std::move(fewer), std::move(sooner)};
}

// Each fault alone, then halves, quarters, … less.
bool Shrinker::drop_faults() {
  if (best_.faults.size() < 2) return false;
  std::vector<ShrinkCase> alone;
  for (std::size_t n = 0; n < best_.faults.size(); ++n) {
    alone.push_back({best_.parts, {best_.faults[n]}});
  }
  if (take_first_of(std::move(alone))) return true;
  bool smaller = false;
  for (std::size_t chunk = best_.faults.size() / 2; chunk > 0 && !stopped_();) {
    std::vector<ShrinkCase> cases;
    for (std::size_t first = 0; first + chunk <= best_.faults.size(); first += chunk)
      std::ranges::move(without_fault(first, chunk), std::back_inserter(cases));
    const bool took = take_first_of(std::move(cases));
    smaller = smaller || took;
    if (!took) chunk /= 2;
    chunk = std::min(chunk, best_.faults.size() - 1);
  }
  return smaller;
}

// Bursts of one.
bool Shrinker::simplify_faults() {
  bool smaller = false;
  for (std::size_t n = 0; n < best_.faults.size() && !stopped_(); ++n) {
    if (best_.faults[n].burst <= 1) continue;
    ShrinkCase simple{best_.parts, best_.faults};
    simple.faults[n].burst = 1;
    if (simple.faults[n].change.size() > 1) simple.faults[n].change.resize(1);
    smaller = take_first_of({std::move(simple)}) || smaller;
  }
  return smaller;
}

// The faults from this one on as far forward as brings it into this turn, at the same place in it: counted
// from its begin, then from its end. The tape ends where the driver failed, so much sooner.
std::vector<ShrinkCase> Shrinker::moved_to(std::size_t turn, std::size_t index) const {
  const auto& turns = best_.end.turns;
  const auto first = best_.faults.begin() + static_cast<std::ptrdiff_t>(index);
  const std::optional<std::size_t> from = has_place(*first) ? turn_of(*first) : std::nullopt;
  if (!from || turn >= *from) return {};
  const std::size_t sooner = turns[*from].part - std::min(turns[turn].part, turns[*from].part);
  const std::size_t reached = std::min(best_.end.reach, best_.parts.size());
  if (sooner == 0 || sooner >= reached) return {};
  const std::uint64_t offset = first->position - begin_of(turns[*from], dir_of(*first));
  const std::uint64_t here = length(turn, dir_of(*first));
  const std::uint64_t there = length(*from, dir_of(*first));
  std::vector<std::uint64_t> offsets;
  if (offset < here) offsets.push_back(offset);
  if (there > offset && there - offset <= here && there != here) offsets.push_back(here - (there - offset));
  std::vector<ShrinkCase> cases;
  for (const std::uint64_t at : offsets) {
    ShrinkCase moved{
        {best_.parts.begin(), best_.parts.begin() + static_cast<std::ptrdiff_t>(reached - sooner)},
        best_.faults};
    bool fits = true;
    for (std::size_t n = index; n < moved.faults.size(); ++n) {
      Fault& fault = moved.faults[n];
      if (!has_place(fault)) continue;
      const LineDir dir = dir_of(fault);
      const std::uint64_t to = begin_of(turns[turn], dir) + (dir == dir_of(*first) ? at : 0);
      const std::uint64_t was = begin_of(turns[*from], dir) + (dir == dir_of(*first) ? offset : 0);
      fits = fits && fault.position + to >= was;
      fault.position += to - was;
    }
    if (fits) cases.push_back(std::move(moved));
  }
  return cases;
}

// All of them, then those behind a fault to that one.
bool Shrinker::move_to_beginning() {
  bool smaller = false;
  for (std::size_t index = 0; index < best_.faults.size() && !stopped_(); ++index) {
    const std::size_t begin = index == 0 ? 0 : turn_of(best_.faults[index - 1]).value_or(0);
    std::vector<ShrinkCase> cases;
    for (std::size_t n = 0; begin + n < best_.end.turns.size(); n += n < kNear ? 1 : n)
      std::ranges::move(moved_to(begin + n, index), std::back_inserter(cases));
    smaller = take_first_of(std::move(cases)) || smaller;
  }
  return smaller;
}

// Only these parts. The driver may leave the others out, so that what follows comes sooner, or ask all the
// same.
std::vector<ShrinkCase> Shrinker::with_parts(const std::vector<std::size_t>& parts) const {
  const auto& turns = best_.end.turns;
  const auto stays = [&](std::size_t turn) {
    const std::size_t part = turns[turn].part;
    return part >= best_.parts.size() || std::ranges::binary_search(parts, best_.parts[part]);
  };
  ShrinkCase same{parts, best_.faults};
  ShrinkCase sooner{parts, {}};
  for (Fault fault : best_.faults) {
    const std::optional<std::size_t> last = has_place(fault) ? turn_of(fault) : std::nullopt;
    if (last && !stays(*last)) continue;
    for (std::size_t turn = 0; last && turn < *last; ++turn) {
      if (!stays(turn)) fault.position -= std::min(fault.position, length(turn, dir_of(fault)));
    }
    sooner.faults.push_back(std::move(fault));
  }
  return {std::move(sooner), std::move(same)};
}

bool Shrinker::drop_parts() {
  bool smaller = false;
  for (std::size_t chunk = (best_.parts.size() + 1) / 2;
       chunk > 0 && best_.parts.size() > 1 && !stopped_();) {
    std::vector<ShrinkCase> cases;
    for (std::size_t first = 0; first < best_.parts.size(); first += chunk) {
      std::vector<std::size_t> parts = best_.parts;
      const auto begin = parts.begin() + static_cast<std::ptrdiff_t>(first);
      parts.erase(begin, begin + static_cast<std::ptrdiff_t>(std::min(chunk, parts.size() - first)));
      std::ranges::move(with_parts(parts), std::back_inserter(cases));
    }
    const bool took = take_first_of(std::move(cases));
    smaller = smaller || took;
    if (!took) chunk /= 2;
    chunk = std::min(chunk, best_.parts.size() / 2 + best_.parts.size() % 2);
  }
  return smaller;
}

}  // namespace porttape
