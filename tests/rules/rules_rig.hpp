#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include <gtest/gtest.h>

#include "libport/rules/rule_expectation.hpp"
#include "libport/rules/rules_reader.hpp"
#include "tests/replay/rig.hpp"

namespace porttape::test {

inline RuleSet rules_of(std::string_view text) {
  const Result<RuleSet> rules = read_rules(text, "my.rules");
  EXPECT_TRUE(rules) << rules.error().message;
  return rules ? *rules : RuleSet();
}

struct Outcome {
  Verdict verdict = Verdict::pass;
  std::uint64_t offset = 0;  // of the mismatch in what the driver wrote
  std::uint64_t tape_offset = 0;
  std::string got;
  std::string why;
  std::string answers;
  friend bool operator==(const Outcome&, const Outcome&) = default;
  friend void PrintTo(const Outcome& outcome, std::ostream* out) {
    *out << to_string(outcome.verdict) << " at " << outcome.offset << " (tape " << outcome.tape_offset
         << "), got \"" << outcome.got << "\", why \"" << outcome.why << "\", answers \"" << outcome.answers
         << '"';
  }
};

// The driver writes `text` in parts of `cut` bytes, `apart_us` apart, against the tape in pieces of `piece`.
inline Outcome play(const MemoryTape& tape, const Expectation& rules, std::string_view text, std::size_t cut,
                    std::size_t piece, std::int64_t apart_us = 0) {
  Rig rig(tape, {.on_mismatch = OnMismatch::fail}, true, piece, {.expectation = &rules});
  rig.open();
  for (std::size_t at = 0; at < text.size(); at += cut) rig.write(text.substr(at, cut)).wait(apart_us);
  rig.wait(10'000'000);
  const Verdict verdict = rig.finish_unless_ended();
  Outcome outcome;
  outcome.verdict = verdict;
  outcome.answers = rig.read();
  if (rig.report->mismatch) {
    const Mismatch& mismatch = *rig.report->mismatch;
    outcome.offset = mismatch.offset;
    outcome.tape_offset = mismatch.tape_offset;
    outcome.why = mismatch.why;
  }
  return outcome;
}

// The same whatever the cuts: what came of it.
inline Outcome play_cut(const MemoryTape& tape, const Expectation& rules, std::string_view text) {
  const Outcome whole = play(tape, rules, text, std::max<std::size_t>(text.size(), 1), 1'000'000);
  for (const std::size_t cut : {1U, 2U, 3U, 5U, 8U, 13U}) {
    for (const std::size_t piece : {1U, 2U, 3U, 7U, 100U}) {
      const Outcome other = play(tape, rules, text, cut, piece);
      EXPECT_EQ(other.verdict, whole.verdict) << "cut " << cut << ", pieces " << piece;
      EXPECT_EQ(other.offset, whole.offset) << "cut " << cut << ", pieces " << piece;
      EXPECT_EQ(other.why, whole.why) << "cut " << cut << ", pieces " << piece;
      EXPECT_EQ(other.answers, whole.answers) << "cut " << cut << ", pieces " << piece;
    }
  }
  return whole;
}

}  // namespace porttape::test
