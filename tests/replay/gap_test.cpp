// What a gap of the tape swallowed is not the driver's fault; behind the gap all is checked as before.

#include <algorithm>
#include <random>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/replay/rig.hpp"
#include "tests/support/random_tape.hpp"

namespace porttape::test {
namespace {

using testing::HasSubstr;

MemoryTape swallowed() {
  return MemoryTape()
      .write(0, "one\n")
      .read(1'000, "1")
      .gap(90'000, 7, 50'000)
      .write(100'000, "three\n")
      .read(101'000, "3")
      .write(110'000, "four\n")
      .read(111'000, "4");
}

TEST(Gap, WhatItSwallowedIsNoMismatch) {
  Rig rig(swallowed(), failing());
  rig.open().write("one\n").wait(10'000).write("two\n").wait(10'000).write("three\n").wait(10'000);
  EXPECT_EQ(rig.read(), "13");
  rig.write("four\n").wait(10'000).close();
  EXPECT_EQ(rig.read(), "4");
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(exit_status_of(*rig.report), 0);
  EXPECT_EQ(rig.report->mismatches, 0U);
  ASSERT_EQ(rig.report->doubts.size(), 1U);
  EXPECT_EQ(rig.report->doubts.at(0).kind, Doubt::Kind::gap);
  EXPECT_EQ(
      rig.report->doubts.at(0).text,
      "7 bytes are missing on the tape from 0.050000 s to 0.090000 s (disk full): what the driver wrote "
      "there was not compared");
  EXPECT_THAT(to_text(*rig.report), testing::StartsWith("pass, with doubts"));
  EXPECT_THAT(to_json(*rig.report), HasSubstr(R"("doubts":[{"kind":"gap","text":"7 bytes)"));
}

TEST(Gap, BehindItCheckingIsAsStrictAsBefore) {
  Rig rig(swallowed(), failing());
  rig.open().write("one\n").wait(10'000).write("two\n").write("three\n").wait(10'000).write("five\n");
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.report->doubts.size(), 1U);
}

TEST(Gap, MoreThanItSwallowedIsAMismatch) {
  Rig rig(swallowed(), failing());
  rig.open().write("one\n").wait(10'000).write("12345678");
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.report->mismatch->offset, 11U);
}

TEST(Gap, ARunThatDoesNotComeToItHasNoDoubt) {
  Rig rig(swallowed(), failing());
  rig.open().write("one\n").wait(10'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::incomplete);
  EXPECT_TRUE(rig.report->doubts.empty());
}

TEST(Gap, OneWithoutBytesIsOnlyADoubt) {
  const auto tape = MemoryTape().write(0, "one").gap(5, 0, 1).write(10, "two").read(11, "2");
  Rig good(tape, failing());
  good.open().write("onetwo").wait(1'000).close();
  EXPECT_EQ(good.verdict(), Verdict::pass);
  EXPECT_EQ(good.report->doubts.size(), 1U);
  Rig bad(tape, failing());
  bad.open().write("onexxtwo");
  EXPECT_EQ(bad.verdict(), Verdict::data_mismatch);
}

// The swallowed polls look like those behind the gap; those that are left over at the end are the gap's.
TEST(Gap, RepeatedPollsAreCounted) {
  MemoryTape tape;
  tape.write(0, "start\n").gap(1'000, 50, 10);
  for (int i = 0; i < 5; ++i) tape.write(2'000 + i, "poll\n");
  tape.write(3'000, "stop\n");
  for (const int polls : {5, 10, 15}) {
    Rig rig(tape, failing());
    rig.open().write("start\n");
    for (int i = 0; i < polls; ++i) rig.write("poll\n");
    rig.write("stop\n").wait(1'000).close();
    EXPECT_EQ(rig.verdict(), Verdict::pass) << polls;
  }
  Rig rig(tape, failing());
  rig.open().write("start\n");
  for (int i = 0; i < 16; ++i) rig.write("poll\n");
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
}

TEST(Gap, AtTheEndOfTheTape) {
  Rig rig(MemoryTape().write(0, "one").read(1, "1").gap(9, 3, 5), failing());
  rig.open().write("one").wait(100).write("two").wait(100'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->doubts.size(), 1U);
}

// An answer whose question is missing comes when the driver has asked something and waits.
TEST(Gap, AnAnswerWithoutItsQuestionWaitsForTheDriver) {
  const auto tape = MemoryTape()
                        .write(0, "one")
                        .read(1'000, "1")
                        .gap(90'000, 3, 50'000)
                        .read(100'000, "2")
                        .write(110'000, "three");
  Rig rig(tape, failing());
  rig.open().write("one").until(200'000);
  EXPECT_EQ(rig.read(), "1");
  rig.write("two").wait(49'000);
  EXPECT_EQ(rig.read(), "");
  rig.wait(2'000);
  EXPECT_EQ(rig.read(), "2");
  rig.write("three").wait(1'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Gap, ADeviceThatIsNeverAskedGoesOnByItself) {
  Rig rig(MemoryTape().read(1'000, "a").gap(90'000, 3, 50'000).read(100'000, "b"), failing());
  rig.open().until(100'000);
  EXPECT_EQ(rig.delivered, "ab");
}

// A driver that waits for an answer that is lost gets the next one at last.
TEST(Gap, ADriverThatWaitsGetsTheNextAnswer) {
  Rig rig(swallowed(), failing());
  rig.open().write("one\n").wait(10'000).write("two\n").wait(5'000'000);
  EXPECT_EQ(rig.read().substr(0, 2), "13");
  rig.write("three\n").wait(10'000).write("four\n").wait(10'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Gap, NoTimeIsHeldAgainstTheFirstWriteBehindIt) {
  ReplayConfig config = failing(2);
  Rig rig(swallowed(), config);
  rig.open().write("one\n").wait(2'000).write("two\nthree\n").until(20'000).write("four\n").close();
  EXPECT_EQ(rig.verdict(), Verdict::pass) << to_text(*rig.report);
}

// A stretch of a random tape is lost; the driver writes all that the tape's did.
TEST(Gap, AnyStretchMayBeMissing) {
  for (std::uint64_t seed = 0; seed < 2'000; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    const auto dice = [&random](std::uint32_t n) {
      return n == 0 ? 0U : static_cast<std::uint32_t>(random() % n);
    };
    const MemoryTape whole = random_tape(dice);
    const auto& entries = whole.entries();
    if (entries.empty()) continue;
    const std::size_t begin = dice(static_cast<std::uint32_t>(entries.size()));
    const std::size_t end = begin + 1 + dice(static_cast<std::uint32_t>(entries.size() - begin));
    MemoryTape cut;
    std::uint64_t lost = 0;
    for (std::size_t i = 0; i < entries.size(); ++i) {
      const auto& entry = entries[i];
      const bool kept = i < begin || i >= end;
      if (!kept) lost += entry.data.size();
      if (i == std::min(end, entries.size()) - 1) {
        if (kept) continue;
        cut.gap(entry.us + 1, lost, entries[begin].us);
      }
      if (!kept) continue;
      const std::int64_t us = entry.us + (i < begin ? 0 : 2);
      if (entry.kind == RecordKind::read) cut.read(us, entry.data);
      if (entry.kind == RecordKind::write) cut.write(us, entry.data);
    }
    Rig rig(cut, failing(), true, 1 + dice(9));
    rig.open();
    for (const auto& entry : entries) {
      if (entry.kind != RecordKind::write || entry.data.empty()) continue;
      rig.write(entry.data);
      if (dice(2) == 0) rig.wait(dice(30'000));
    }
    rig.wait(100'000'000).close();
    ASSERT_EQ(rig.verdict(), Verdict::pass) << to_text(*rig.report);
    ASSERT_EQ(rig.report->from_driver_matched, cut.all(RecordKind::write).size());
    ASSERT_EQ(rig.delivered, cut.all(RecordKind::read));
  }
}

}  // namespace
}  // namespace porttape::test
