#include "libport/faults/fault_stream.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

namespace porttape {
namespace {

constexpr std::uint64_t kChanges = 64;  // of a strike's bytes, then the same ones again

// What the nth byte of a strike at this position is XORed with.
Byte drawn_change(const FaultWatch& watch, std::uint64_t position, std::uint64_t nth) {
  return static_cast<Byte>(1 + watch.drawn(position + nth % kChanges) % 255);
}

bool breaks(const Fault& fault) {
  return fault.kind == Fault::Kind::hangup || fault.kind == Fault::Kind::replug;
}

bool can_strike(const Fault& fault, LineDir dir) {
  if (fault.dir && *fault.dir != dir) return false;
  const bool by_clock = breaks(fault) && fault.when == Fault::When::time;  // whether bytes come or not
  return !by_clock && (fault.when != Fault::When::chance || fault.chance > 0);
}

}  // namespace

// What becomes of each byte of an arrival.
struct FaultStream::Marks {
  struct Mark {
    bool gone = false;
    Byte change = 0;
    Instant due{};
  };
  struct Double {
    std::size_t behind;  // this byte
    Bytes data;
    bool arrives_apart;
  };
  ByteView arrival;
  Instant now;
  Instant zero;
  std::vector<Mark> of;
  std::vector<Double> doubles;
};

FaultStream::FaultStream(const FaultPlan& plan, std::uint64_t seed, LineDir dir, bool datagrams)
    : dir_(dir), datagrams_(datagrams) {
  for (std::size_t index = 0; index < plan.faults.size(); ++index) {
    const Fault& fault = plan.faults[index];
    if (can_strike(fault, dir)) watched_.push_back({&fault, FaultWatch(fault, index, seed, dir, datagrams)});
  }
}

FaultStream::Outcome FaultStream::take(ByteView arrival, Instant now, Instant zero) {
  Outcome outcome;
  if (watched_.empty()) return outcome;
  const Nanos elapsed = now - zero;
  const ByteView whole = std::exchange(arrival, up_to_break(arrival, elapsed, outcome));
  Marks marks{arrival, now, zero, {}, {}};
  if (stands_until_ > now) marks.of.assign(arrival.size(), {.due = stands_until_});
  std::vector<FaultWatch::Hit> hits;
  for (Watched& each : watched_) {
    const std::uint64_t begin = each.watch.position();
    hits.clear();
    each.watch.look(arrival, elapsed, hits);
    if (hits.empty()) continue;
    if (marks.of.empty()) marks.of.resize(arrival.size());
    mark(each, begin, hits, marks);
    for (const FaultWatch::Hit& hit : hits) {
      if (hit.nth == 0) note(each, begin + hit.at, outcome);
    }
  }
  std::ranges::stable_sort(outcome.faults, {}, &LineFault::offset);  // as they would come byte by byte
  outcome.untouched = marks.of.empty() && arrival.size() == whole.size();
  if (!outcome.untouched) put_together(marks, outcome);
  return outcome;
}

// What comes before the first of the faults that break the line, and its byte. The rest is not of the stream.
ByteView FaultStream::up_to_break(ByteView arrival, Nanos elapsed, Outcome& outcome) const {
  for (const Watched& each : watched_) {
    if (!breaks(*each.fault)) continue;
    FaultWatch ahead = each.watch;
    std::vector<FaultWatch::Hit> hits;
    ahead.look(arrival, elapsed, hits);
    if (hits.empty()) continue;
    arrival = arrival.first(hits.front().at + 1);
    outcome.broken = each.fault;
  }
  return arrival;
}

void FaultStream::mark(Watched& watched, std::uint64_t begin, const std::vector<FaultWatch::Hit>& hits,
                       Marks& marks) {
  const Fault& fault = *watched.fault;
  for (const FaultWatch::Hit& hit : hits) {
    Marks::Mark& mark = marks.of[hit.at];
    switch (fault.kind) {
      case Fault::Kind::drop:
      case Fault::Kind::truncate:
      case Fault::Kind::hangup:
      case Fault::Kind::replug:
        mark.gone = true;
        break;
      case Fault::Kind::corrupt:
        mark.change ^= fault.change.empty() ? drawn_change(watched.watch, begin + hit.at - hit.nth, hit.nth)
                                            : fault.change[hit.nth % fault.change.size()];
        break;
      case Fault::Kind::duplicate:
        double_bytes(watched, hit, marks);
        break;
      case Fault::Kind::delay:
        mark.due = std::max(mark.due, marks.now + fault.length);
        break;
      case Fault::Kind::stall:
        hold(fault, hit.at, marks);
        break;
    }
  }
}

void FaultStream::hold(const Fault& fault, std::size_t at, Marks& marks) {
  const Instant begin = fault.when == Fault::When::time ? marks.zero + fault.at : marks.now;
  const Instant until = begin + fault.length;
  for (; at < marks.of.size(); ++at) marks.of[at].due = std::max(marks.of[at].due, until);
  stands_until_ = std::max(stands_until_, until);
}

void FaultStream::double_bytes(Watched& watched, const FaultWatch::Hit& hit, Marks& marks) const {
  if (hit.nth == 0) watched.doubled.clear();
  if (watched.doubled.size() < kMostDoubled) watched.doubled.push_back(marks.arrival[hit.at]);
  const bool frames = watched.fault->unit != Fault::Unit::byte;
  if (hit.last) marks.doubles.push_back({hit.at, std::exchange(watched.doubled, {}), datagrams_ && frames});
}

// A plan that makes this strike again. What was drawn is told, and so it needs no seed.
void FaultStream::note(Watched& watched, std::uint64_t position, Outcome& outcome) const {
  Fault once = *watched.fault;
  if (once.when != Fault::When::time) {
    once.when = Fault::When::byte;
    once.position = position;
  }
  once.dir = dir_;
  once.times = 0;
  once.keep.reset();
  if (once.unit == Fault::Unit::automatic && datagrams_) once.unit = Fault::Unit::frame;
  if (once.kind == Fault::Kind::corrupt && once.change.empty()) {
    for (std::uint64_t n = 0; n < std::min(once.burst, kChanges); ++n)
      once.change.push_back(drawn_change(watched.watch, position, n));
  }
  outcome.faults.push_back(
      {.kind = std::string(to_string(once.kind)), .spec = to_text(once), .dir = dir_, .offset = position});
}

void FaultStream::put_together(Marks& marks, Outcome& outcome) const {
  static constexpr Marks::Mark kNone;
  std::ranges::stable_sort(marks.doubles, {}, &Marks::Double::behind);
  const auto put = [&](ByteView data, Instant due) {
    std::vector<Piece>& pieces = outcome.pieces;
    if (pieces.empty() || (!datagrams_ && pieces.back().due != due)) pieces.push_back({{}, due});
    pieces.back().due = std::max(pieces.back().due, due);
    pieces.back().data.insert(pieces.back().data.end(), data.begin(), data.end());
  };
  std::vector<Piece> apart;
  auto next = marks.doubles.begin();
  for (std::size_t at = 0; at < marks.arrival.size(); ++at) {
    const Marks::Mark& mark = marks.of.empty() ? kNone : marks.of[at];
    const Byte byte = static_cast<Byte>(marks.arrival[at] ^ mark.change);
    if (!mark.gone) put({&byte, 1}, mark.due);
    for (; next != marks.doubles.end() && next->behind == at; ++next) {
      if (next->arrives_apart) {
        apart.push_back({std::move(next->data), mark.due});
      } else {
        put(next->data, mark.due);
      }
    }
  }
  std::ranges::move(apart, std::back_inserter(outcome.pieces));
}

}  // namespace porttape
