#include "libport/infer/proof.hpp"

#include <gtest/gtest.h>

#include "tests/infer/sessions.hpp"

namespace porttape {
namespace {

using test::session;

RuleExpectation rules(std::vector<Rule> rows) {
  RuleSet set;
  FrameFormat line;
  line.name = "line";
  line.end = {'\n'};
  set.frames.push_back(line);
  set.rules = std::move(rows);
  return RuleExpectation(std::move(set));
}

Rule ignore(std::int64_t at, std::int64_t size) {
  Rule rule;
  rule.name = "any";
  rule.place.at = at;
  rule.place.size = size;
  return rule;
}

Proof prove_all(const RuleExpectation& rules, std::span<const SessionTape> tapes,
                const ProofLimits& limits = {}) {
  Looks looks;
  return prove(rules, tapes, limits, looks);
}

std::optional<SessionDifference> hold(const RuleExpectation& rules, const SessionTape& recorded,
                                      const SessionTape& came) {
  Looks looks;
  return hold_against(rules, recorded, came, looks);
}

TEST(Proof, WithoutRulesEveryChangeIsFound) {
  const std::vector tapes{session(test::MemoryTape().write(1, "GET 1\n").write(2, "GET 2\nSET"))};
  const Proof proof = prove_all(rules({}), tapes);
  EXPECT_TRUE(proof.holds());
  EXPECT_EQ(proof.bytes, 15U);
  EXPECT_EQ(proof.tried, 15U);
  EXPECT_EQ(proof.inside, 0U);
}

TEST(Proof, WhatMayVaryIsCountedApart) {
  const std::vector tapes{session(test::MemoryTape().write(1, "GET 1\n")),
                          session(test::MemoryTape().write(1, "GET 2\n"))};
  EXPECT_FALSE(prove_all(rules({}), tapes).passes());
  const Proof proof = prove_all(rules({ignore(4, 1)}), tapes);
  EXPECT_TRUE(proof.holds());
  EXPECT_EQ(proof.inside, 2U);
  EXPECT_EQ(proof.bytes, 10U);
}

TEST(Proof, AChangeThatARuleHidesIsMissed) {
  Rule rule;
  rule.name = "any line, any number of times";
  rule.kind = Rule::Kind::frame;
  rule.optional = rule.repeated = true;
  const std::vector tapes{session(test::MemoryTape().write(1, "GET 1\n").write(2, "GET 2\n"))};
  const Proof proof = prove_all(rules({rule}), tapes);
  EXPECT_TRUE(proof.passes());
  EXPECT_FALSE(proof.holds());
  EXPECT_GT(proof.missed_count, 0U);
  ASSERT_FALSE(proof.missed.empty());
  EXPECT_EQ(proof.missed.front().at, 0U);
  EXPECT_EQ(proof.missed.front().was, 'G');
}

test::MemoryTape hundred_lines() {
  test::MemoryTape tape;
  for (int i = 0; i < 100; ++i) tape.write(i, "0123456789\n");
  return tape;
}

TEST(Proof, OfManyBytesASampleIsTried) {
  const Proof proof = prove_all(rules({}), std::vector{session(hundred_lines())}, {.changes = 300});
  EXPECT_TRUE(proof.holds());
  EXPECT_EQ(proof.bytes, 1100U);
  EXPECT_LE(proof.tried * Proof::kChanges, 300U);
  EXPECT_GT(proof.tried, 80U);
}

TEST(Proof, WithFewLooksFewerChangesAreTried) {
  Looks looks(10'000);  // 100 for the tape itself, 24 for each change
  const Proof proof = prove(rules({}), std::vector{session(hundred_lines())}, {}, looks);
  EXPECT_TRUE(proof.holds());
  EXPECT_GT(proof.tried, 80U);
  EXPECT_LT(proof.tried, 200U);
}

TEST(Proof, WithoutLooksNothingIsProven) {
  Looks looks(50);
  const Proof proof = prove(rules({}), std::vector{session(hundred_lines())}, {}, looks);
  EXPECT_FALSE(proof.passes());
  ASSERT_TRUE(proof.pairs.at(0).difference);
  EXPECT_TRUE(proof.pairs[0].difference->given_up);
  EXPECT_EQ(proof.pairs[0].difference->came, 50U * 11);
  EXPECT_TRUE(proof.given_up);
  EXPECT_EQ(proof.tried, 0U);
}

TEST(Proof, AChangeThatWasNotLookedForIsNoMissedOne) {
  Rule rule;
  rule.name = "any line, any number of times";
  rule.kind = Rule::Kind::frame;
  rule.optional = rule.repeated = true;
  Looks looks(2000);
  const Proof proof = prove(rules({rule}), std::vector{session(hundred_lines())}, {}, looks);
  EXPECT_TRUE(proof.passes());
  EXPECT_TRUE(proof.given_up);
  EXPECT_FALSE(proof.holds());
}

TEST(Proof, ADifferenceHasItsPlace) {
  const SessionTape one = session(test::MemoryTape().write(1, "GET 1\n").write(2, "GET 2\n"));
  const SessionTape other = session(test::MemoryTape().write(1, "GET 1\n").write(2, "GET 3\n"));
  const auto difference = hold(rules({}), one, other);
  ASSERT_TRUE(difference);
  EXPECT_EQ(difference->recorded, 10U);
  EXPECT_EQ(difference->came, 10U);
  EXPECT_FALSE(difference->at_end);
  const SessionTape less = session(test::MemoryTape().write(1, "GET 1\n"));
  EXPECT_TRUE(hold(rules({}), one, less)->at_end);
  EXPECT_FALSE(hold(rules({}), less, one)->at_end);
}

}  // namespace
}  // namespace porttape
