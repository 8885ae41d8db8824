// No call of the engine reads more of the tape than a budget holds, whatever the tape; and what it has to do
// is done nonetheless.

#include <algorithm>
#include <functional>
#include <string>

#include <gtest/gtest.h>

#include "libport/replay/budget.hpp"
#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

constexpr int kMany = 50'000;  // empty blocks, many budgets' worth

MemoryTape& add_empty(MemoryTape& tape, std::int64_t us, bool writes = true) {
  for (int i = 0; i < kMany; ++i) writes&& i % 2 == 0 ? tape.write(us, "") : tape.read(us, "");
  return tape;
}

// A driver whose every step is watched: how much the engine has read of the tape in it.
class Watched {
 public:
  explicit Watched(MemoryTape tape, const ReplayConfig& config = {}) : rig(std::move(tape), config) {}

  Watched& open() {
    return step([this] { rig.engine.on_open(rig.now()); });
  }
  Watched& write(std::string_view text) {
    return step([this, text] { rig.engine.on_write(rig.now(), as_bytes(text)); });
  }
  Watched& close() {
    return step([this] { rig.engine.on_close(rig.now()); });
  }
  Watched& finish() {
    return step([this] { rig.engine.finish(rig.now()); });
  }
  // Lets the engine do all that it has to do now.
  Watched& settle() {
    while (rig.engine.next_deadline().value_or(Instant::max()) <= rig.now()) {
      step([this] { rig.advance(); });
      ++advances;
    }
    return *this;
  }
  Watched& step(const std::function<void()>& call) {
    const std::size_t before = rig.schedule.calls() + rig.writes.calls();
    call();
    most = std::max(most, rig.schedule.calls() + rig.writes.calls() - before);
    return *this;
  }

  Rig rig;
  std::size_t most = 0;
  int advances = 0;
};

constexpr std::size_t kBound = 3 * Budget::kRecords;  // the walk, the writes, a look ahead

TEST(Bounded, EmptyBlocksAtTheStart) {
  MemoryTape tape;
  add_empty(tape, 0).write(0, "ask").read(0, "answer");
  Watched driver(tape, failing());
  driver.open().write("as").write("k").settle();
  EXPECT_EQ(driver.rig.delivered, "answer");
  driver.close().settle();
  EXPECT_EQ(driver.rig.verdict(), Verdict::pass);
  EXPECT_LE(driver.most, kBound);
  EXPECT_GT(driver.advances, kMany / 4096);
}

TEST(Bounded, TheEndOfARunWithMuchOfTheTapeLeft) {
  MemoryTape tape;
  tape.write(0, "ask").read(0, "answer");
  add_empty(tape, 1);
  Watched driver(tape, failing());
  driver.open().write("ask").step([&] { driver.rig.advance(); }).close().settle();
  EXPECT_EQ(driver.rig.delivered, "answer");
  EXPECT_EQ(driver.rig.verdict(), Verdict::pass);
  EXPECT_EQ(driver.rig.report->to_driver_of, 6U);
  EXPECT_LE(driver.most, kBound);
  EXPECT_LT(driver.advances, 5);
}

TEST(Bounded, AnAnswerDoesNotWaitForWhatTheTapeHasBehindTheQuestion) {
  MemoryTape tape;
  tape.write(0, "ask").read(0, "answer");
  add_empty(tape, 1).write(1, "again");
  Watched driver(tape, failing());
  driver.open().write("ask").step([&] { driver.rig.advance(); });
  EXPECT_EQ(driver.rig.delivered, "answer");
  driver.write("again").close().settle();
  EXPECT_EQ(driver.rig.verdict(), Verdict::pass);
  EXPECT_LE(driver.most, kBound);
}

// The count alone says whether anything is missing.
TEST(Bounded, WithoutACountTheVerdictStaysOpenUntilThereIsOne) {
  for (const bool missing : {false, true}) {
    MemoryTape tape;
    tape.write(0, "ask");
    add_empty(tape, 1);
    if (missing) tape.write(2, "more");
    MemorySource schedule(tape);
    MemorySource writes(tape, MemorySource::Select::writes_only);
    Engine engine(failing(), {}, schedule, writes);
    const Instant now{Micros{1}};
    engine.on_open(now);
    engine.on_write(now, as_bytes("ask"));
    engine.on_close(now);
    RunReport report = engine.advance(now).run_ended.value();
    EXPECT_EQ(report.undecided_from, 3U);
    EXPECT_EQ(report.from_driver_of, std::nullopt);
    RunReport uncounted = report;
    add_totals(report, {0, missing ? 7U : 3U});
    EXPECT_EQ(report.verdict, missing ? Verdict::incomplete : Verdict::pass);
    give_up_totals(uncounted, "it was not counted");
    EXPECT_EQ(uncounted.verdict, Verdict::incomplete);
    EXPECT_EQ(exit_status_of(uncounted), 1);
  }
}

TEST(Bounded, ARecordedReopenFarOn) {
  MemoryTape tape;
  tape.open(0).write(0, "one").read(0, "1");
  add_empty(tape, 1).close(2).open(3);
  add_empty(tape, 3).write(4, "two").read(4, "2").close(5);
  Watched driver(tape, failing());
  driver.open().write("one").step([&] { driver.rig.advance(); });
  driver.close().open().write("two").close().settle();
  EXPECT_EQ(driver.rig.runs, 1);
  EXPECT_EQ(driver.rig.verdict(), Verdict::pass);
  EXPECT_LE(driver.most, kBound);
}

TEST(Bounded, TheWritesOfADriverFarAheadAreJudged) {
  for (const std::int64_t due : {1'000, 500'000}) {
    MemoryTape tape;
    tape.write(0, "one");
    add_empty(tape, 1, false).read(due, "1").write(due, "two");
    Watched driver(tape, failing(2));
    driver.open().write("onetwo").finish().settle();
    EXPECT_EQ(driver.rig.verdict(), due == 1'000 ? Verdict::pass : Verdict::timing_mismatch);
    EXPECT_LE(driver.most, kBound);
  }
}

TEST(Bounded, OneLargeWriteAgainstSingleBytes) {
  MemoryTape tape;
  for (int i = 0; i < kMany; ++i) tape.write(i, "x");
  tape.read(kMany, "done");
  Watched driver(tape, failing());
  driver.open().write(std::string(kMany, 'x'));
  EXPECT_GT(driver.rig.engine.backlog(), 0U);
  driver.settle();
  EXPECT_EQ(driver.rig.engine.backlog(), 0U);
  driver.rig.wait(10);
  EXPECT_EQ(driver.rig.delivered, "done");
  EXPECT_LE(driver.most, kBound);
}

// A driver's silence is none while what it wrote was not looked at.
TEST(Bounded, WhatWaitsToBeComparedIsNoSilence) {
  MemoryTape tape;
  tape.write(0, "one").read(0, "1");
  add_empty(tape, 1).write(1, "two").read(1, "2").write(2, "three").read(2, "3");
  Watched driver(tape);
  driver.open().write("eno").settle();
  EXPECT_EQ(driver.rig.delivered, "1");
  driver.rig.stall(100'000);
  driver.write("two").settle();
  driver.write("three").settle();
  driver.close().settle();
  EXPECT_EQ(driver.rig.delivered, "123");
  EXPECT_EQ(driver.rig.report->mismatches, 1U);
  EXPECT_LE(driver.most, kBound);
}

TEST(Bounded, GivingUpEndsTheRunAtOnce) {
  MemoryTape tape;
  tape.write(0, "one");
  add_empty(tape, 1).write(1, "two");
  Watched driver(tape, failing());
  driver.open().write("onetwo").finish();
  driver.step([&] { driver.rig.engine.give_up(driver.rig.now()); });
  EXPECT_TRUE(driver.rig.engine.finished());
  driver.settle();
  EXPECT_EQ(driver.rig.runs, 1);
  EXPECT_EQ(driver.rig.verdict(), Verdict::incomplete);
  EXPECT_LE(driver.most, kBound);
}

}  // namespace
}  // namespace porttape::test
