#include "libport/infer/proof.hpp"

#include <algorithm>
#include <array>

#include "libport/replay/budget.hpp"
#include "libport/replay/matcher.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/rules/framing.hpp"

namespace porttape {
namespace {

constexpr Micros kPause{500};  // as of a replay
constexpr std::size_t kMostMissed = 16;
constexpr std::size_t kLookSize = 64;
constexpr std::size_t kAround = 8;  // frames on each side of a change that are compared with it

// One session written to a matcher of another.
class Comparer {
 public:
  Comparer(const RuleExpectation& rules, const SessionTape& recorded, Looks& looks)
      : looks_(looks),
        rules_(rules.book().set().rules.size() + 1),
        source_(recorded),
        matcher_(source_, budget_, clock_, kPause, &rules) {
    matcher_.rewind();
  }

  std::optional<SessionDifference> write_all(const SessionTape& came) {
    for (const SessionTape::Block& block : came.blocks) {
      if (block.direction != Direction::write) continue;
      const Instant now{block.at.time_since_epoch()};
      if (!look(block.size)) return given_up();
      if (!pause_until(now) || !write(now, came.bytes_of(block))) return difference(false);
    }
    if (looks_.spent()) return given_up();
    Matcher::Step end;
    do {
      budget_.refill();
      end = matcher_.end_session();
    } while (end.outcome == Matcher::Outcome::later);
    if (end.outcome == Matcher::Outcome::differs) return difference(false);
    budget_.refill();
    return matcher_.any_unsent().value_or(false) ? std::optional(difference(true)) : std::nullopt;
  }

 private:
  using Outcome = Matcher::Outcome;

  bool write(Instant now, ByteView bytes) {
    while (!bytes.empty() || matcher_.goes_on()) {
      budget_.refill();
      const Matcher::Step step = matcher_.write(now, bytes);
      bytes = bytes.subspan(step.used);
      if (step.outcome == Outcome::differs || step.outcome == Outcome::extra) return false;
    }
    return true;
  }

  // What the driver's silence ends before it writes at `now`.
  bool pause_until(Instant now) {
    while (const auto due = matcher_.pause_due()) {
      if (*due > now || !look(0)) break;
      budget_.refill();
      const Matcher::Step step = matcher_.pause();
      if (step.outcome == Outcome::differs || step.outcome == Outcome::extra) return false;
    }
    return true;
  }

  bool look(std::size_t bytes) { return looks_.take(rules_ * (1 + bytes / kLookSize)); }

  [[nodiscard]] SessionDifference given_up() const {
    SessionDifference here = difference(false);
    here.given_up = true;
    return here;
  }
  [[nodiscard]] SessionDifference difference(bool at_end) const {
    return {static_cast<std::size_t>(matcher_.position()),
            static_cast<std::size_t>(matcher_.written()),
            at_end,
            {},
            false};
  }

  Looks& looks_;
  std::size_t rules_;
  Budget budget_;
  SessionWrites source_;
  ReplayClock clock_{1};  // never moved by hand
  Matcher matcher_;
};

// A frame of a session, or bytes of none, with what of it may vary.
struct Stretch {
  std::size_t begin = 0;
  std::size_t size = 0;
  std::vector<FrameSpan> free;
};

std::vector<Stretch> stretches_of(const RuleBook& book, const SessionTape& session) {
  std::vector<Stretch> all;
  std::size_t at = 0;
  for (const SessionTape::Block& block : session.blocks) {
    if (block.direction != Direction::write) continue;
    const std::size_t end = block.begin + block.size;
    while (at < end) {
      const bool by_pause = book.idle() < Micros::max();
      const ByteView rest =
          ByteView(session.writes).first(by_pause ? end : session.writes.size()).subspan(at);
      const FrameCut cut = cut_frame(book.set().frames, rest, true);
      Stretch stretch{at, std::max<std::size_t>(cut.size, 1), {}};
      if (cut.state == FrameCut::State::frame) {
        for (const FrameField& field : book.layout(rest.first(cut.size), cut.format).fields)
          if (field.of == FrameField::Of::rule) stretch.free.push_back(field.span);
      }
      at += stretch.size;
      all.push_back(std::move(stretch));
    }
  }
  return all;
}

// The part of a session's writes from `begin` up to `end`, as a session of its own.
SessionTape part_of(const SessionTape& session, std::size_t begin, std::size_t end) {
  SessionTape part;
  const auto at = [&](std::size_t offset) {
    return session.writes.begin() + static_cast<std::ptrdiff_t>(offset);
  };
  part.writes.assign(at(begin), at(end));
  for (SessionTape::Block block : session.blocks) {
    if (block.direction != Direction::write) continue;
    const std::size_t from = std::max(block.begin, begin);
    const std::size_t to = std::min(block.begin + block.size, end);
    if (from >= to) continue;
    block.begin = from - begin;
    block.size = to - from;
    part.blocks.push_back(block);
  }
  return part;
}

// Changes bytes of one session, a few frames around each at a time, so that the time it takes does not grow
// with the square of the session; what is not found there is tried with the whole session.
class Changer {
 public:
  Changer(const RuleExpectation& rules, std::span<const SessionTape> sessions, std::size_t tape,
          std::size_t stride, Proof& proof, Looks& looks)
      : rules_(rules), session_(sessions[tape]), tape_(tape), stride_(stride), proof_(proof), looks_(looks) {}

  void run(std::span<const Stretch> stretches) {
    for (std::size_t first = 0; first < stretches.size() && !looks_.spent(); first += kAround) {
      const std::size_t last = std::min(stretches.size(), first + kAround);
      const Stretch& from = stretches[first - std::min(first, kAround)];
      const Stretch& to = stretches[std::min(stretches.size(), last + kAround) - 1];
      begin_ = from.begin;
      recorded_ = part_of(session_, begin_, to.begin + to.size);
      changed_ = recorded_;
      for (std::size_t i = first; i < last; ++i) change(stretches[i]);
    }
  }

 private:
  void change(const Stretch& stretch) {
    for (std::size_t i = 0; i < stretch.size && !looks_.spent(); ++i) {
      const bool inside = std::ranges::any_of(
          stretch.free, [&](const FrameSpan& span) { return i >= span.begin && i < span.end; });
      ++(inside ? proof_.inside : proof_.bytes);
      if (inside || proof_.bytes % stride_ != 0) continue;
      ++proof_.tried;
      for (const Byte bits : kBits) change(stretch.begin + i, bits);
    }
  }

  void change(std::size_t at, Byte bits) {
    Byte& byte = changed_.writes[at - begin_];
    const Byte was = byte;
    byte ^= bits;
    const auto difference = hold_against(rules_, recorded_, changed_, looks_);
    // At the part's end there may be what the rest of the session puts right.
    const bool found = difference && !difference->at_end && !difference->given_up &&
                       difference->came < changed_.writes.size();
    if (!found && !found_in_all(at, byte) && !looks_.spent()) {
      ++proof_.missed_count;
      if (proof_.missed.size() < kMostMissed) proof_.missed.push_back({tape_, at, was, byte});
    }
    byte = was;
  }

  [[nodiscard]] bool found_in_all(std::size_t at, Byte became) const {
    SessionTape changed = session_;
    changed.writes[at] = became;
    const auto difference = hold_against(rules_, session_, changed, looks_);
    return difference && !difference->given_up;
  }

  // A neighbouring number or letter, the other case, another byte altogether.
  static constexpr std::array<Byte, Proof::kChanges> kBits = {0x01, 0x20, 0xff};

  const RuleExpectation& rules_;
  const SessionTape& session_;
  std::size_t tape_;
  std::size_t stride_;
  Proof& proof_;
  Looks& looks_;
  std::size_t begin_ = 0;
  SessionTape recorded_;
  SessionTape changed_;
};

}  // namespace

std::optional<SessionDifference> hold_against(const RuleExpectation& rules, const SessionTape& recorded,
                                              const SessionTape& came, Looks& looks) {
  return Comparer(rules, recorded, looks).write_all(came);
}

bool Proof::passes() const {
  return std::ranges::none_of(pairs, [](const Pair& pair) { return pair.difference.has_value(); });
}

std::vector<Proof::Pair> hold_all(const RuleExpectation& rules, std::span<const SessionTape> sessions,
                                  Looks& looks) {
  std::vector<Proof::Pair> pairs;
  for (std::size_t recorded = 0; recorded < sessions.size(); ++recorded)
    for (std::size_t came = 0; came < sessions.size(); ++came)
      pairs.push_back({recorded, came, hold_against(rules, sessions[recorded], sessions[came], looks)});
  return pairs;
}

Proof prove(const RuleExpectation& rules, std::span<const SessionTape> sessions, const ProofLimits& limits,
            Looks& looks) {
  Proof proof;
  proof.pairs = hold_all(rules, sessions, looks);
  std::size_t bytes = 0;
  for (const SessionTape& session : sessions) bytes += session.writes.size();
  const std::uint64_t price = 3 * kAround * (rules.book().set().rules.size() + 1);
  const std::uint64_t changes = std::min<std::uint64_t>(limits.changes, looks.left() / price);
  const std::size_t stride = 1 + Proof::kChanges * bytes / std::max<std::uint64_t>(changes, 1);
  for (std::size_t tape = 0; tape < sessions.size() && !looks.spent(); ++tape)
    Changer(rules, sessions, tape, stride, proof, looks).run(stretches_of(rules.book(), sessions[tape]));
  proof.given_up = looks.spent();
  return proof;
}

}  // namespace porttape
