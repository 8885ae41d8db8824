#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "libport/infer/session_tape.hpp"
#include "libport/rules/rule_expectation.hpp"

namespace porttape {

// How much may be compared. A look is that of one rule at some 64 bytes of a frame. They are counted, and no
// time is taken, so that the same tapes have the same proof on each machine.
class Looks {
 public:
  explicit Looks(std::uint64_t most = std::numeric_limits<std::uint64_t>::max()) : left_(most) {}

  // False: so many are not left, and none are from then on.
  bool take(std::uint64_t count) {
    spent_ = spent_ || count > left_;
    left_ = spent_ ? 0 : left_ - count;
    return !spent_;
  }
  [[nodiscard]] std::uint64_t left() const { return left_; }
  [[nodiscard]] bool spent() const { return spent_; }

 private:
  std::uint64_t left_;
  bool spent_ = false;
};

// Where the writes of one session do not go as those of another one were recorded.
struct SessionDifference {
  std::size_t recorded = 0;  // so many bytes of the recorded writes were as they may be
  std::size_t came = 0;      // and so many of those that came
  bool at_end = false;       // all that came was; more was recorded
  std::string why{};         // what the rule says, if one does
  bool given_up = false;     // up to here nothing differs; the looks are spent
};

// Holds the writes of `came`, cut and paced as on its tape, against those of `recorded`: the comparison of a
// replay. Nothing where they may stand for each other.
std::optional<SessionDifference> hold_against(const RuleExpectation& rules, const SessionTape& recorded,
                                              const SessionTape& came, Looks& looks);

struct ProofLimits {
  std::size_t changes = 20'000;  // of bytes that are tried, over all tapes
  // For all of an inference; nothing: what the tapes' size gives, so that it takes seconds, or some more
  // where they have many megabytes.
  std::optional<std::uint64_t> looks{};
};

// What was tried to refute the rules.
struct Proof {
  // Each tape against each one, itself too.
  struct Pair {
    std::size_t recorded = 0;  // of the tapes
    std::size_t came = 0;
    std::optional<SessionDifference> difference;
  };
  std::vector<Pair> pairs{};
  // Of the writes of each tape one byte was changed and held against the tape.
  std::size_t bytes = 0;   // outside of what the rules let vary
  std::size_t tried = 0;   // of them; each with `kChanges` values
  std::size_t inside = 0;  // bytes that the rules let vary
  struct Missed {
    std::size_t tape = 0;
    std::size_t at = 0;  // in its writes
    Byte was = 0;
    Byte became = 0;
  };
  std::vector<Missed> missed{};  // that were outside and not found: the first 16
  std::size_t missed_count = 0;
  bool given_up = false;  // the looks were spent before all of this was known

  static constexpr std::size_t kChanges = 3;
  [[nodiscard]] bool passes() const;  // every pair
  [[nodiscard]] bool holds() const { return passes() && missed_count == 0 && !given_up; }
};
// The pairs alone.
std::vector<Proof::Pair> hold_all(const RuleExpectation& rules, std::span<const SessionTape> sessions,
                                  Looks& looks);
// Where few looks are left fewer changes are tried.
Proof prove(const RuleExpectation& rules, std::span<const SessionTape> sessions, const ProofLimits& limits,
            Looks& looks);

}  // namespace porttape
