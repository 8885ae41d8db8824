// What a driver's close and reopen mean: runs and sessions.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

using ::testing::ElementsAre;

ReplayConfig with(OnReopen on_reopen, OnMismatch on_mismatch = OnMismatch::fail) {
  ReplayConfig config;
  config.on_reopen = on_reopen;
  config.on_mismatch = on_mismatch;
  return config;
}

MemoryTape one_session() { return MemoryTape().write(1'000, "Q").read(2'000, "A"); }

// Three sessions of one exchange each, as a program that opens the port for every request makes them.
MemoryTape three_sessions() {
  MemoryTape tape;
  for (int i = 0; i < 3; ++i) {
    const std::string number = std::to_string(i);
    const std::int64_t start = i * 1'000'000;
    tape.open(start)
        .event(start + 10, event::Unknown{"settings"})
        .write(start + 1'000, "Q" + number)
        .read(start + 2'000, "A" + number);
    tape.close(start + 3'000);
  }
  return tape;
}

TEST(Automatic, ATapeOfSeveralSessionsIsOneRun) {
  Rig rig(three_sessions(), with(OnReopen::automatic));
  for (int i = 0; i < 3; ++i) {
    rig.open().wait(500).write("Q" + std::to_string(i)).wait(1'000);
    EXPECT_EQ(rig.read(), "A" + std::to_string(i));
    EXPECT_EQ(rig.runs, 0);
    rig.close().wait(77'000);
  }
  EXPECT_EQ(rig.runs, 1);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  // And once more.
  rig.open().write("Q0").wait(1'000);
  EXPECT_EQ(rig.read(), "A0");
  EXPECT_EQ(rig.finish(), Verdict::incomplete);
  EXPECT_EQ(rig.runs, 2);
}

TEST(Automatic, ATapeWithoutReopensIsRewound) {
  Rig rig(one_session(), with(OnReopen::automatic));
  for (int i = 1; i <= 3; ++i) {
    rig.open().write("Q").wait(1'000);
    EXPECT_EQ(rig.read(), "A");
    rig.close().wait(1'000);
    EXPECT_EQ(rig.runs, i);
    EXPECT_EQ(rig.verdict(), Verdict::pass);
  }
}

TEST(Automatic, UnreadAnswersBeforeARecordedCloseAreLost) {
  Rig rig(three_sessions(), with(OnReopen::automatic));
  rig.open().write("Q0").close().open().write("Q1").wait(1'000);
  EXPECT_EQ(rig.read(), "A1");
}

TEST(Automatic, AReopenWithNothingExchangedIsNone) {
  Rig rig(three_sessions(), with(OnReopen::automatic));
  rig.open().wait(1'000).close().wait(1'000).open().wait(1'000).close().wait(1'000);
  for (int i = 0; i < 3; ++i) {
    rig.open().write("Q" + std::to_string(i)).wait(1'000);
    EXPECT_EQ(rig.read(), "A" + std::to_string(i));
    rig.close().wait(1'000);
    if (i < 2) rig.open().wait(10).close().wait(10);
  }
  EXPECT_EQ(rig.runs, 1);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Automatic, ALookAtTheLastSessionAloneLeavesTheRunIncomplete) {
  Rig rig(three_sessions(), with(OnReopen::automatic));
  for (int i = 0; i < 2; ++i) {
    rig.open().write("Q" + std::to_string(i)).wait(1'000).close().wait(1'000);
  }
  rig.open().wait(10).close().wait(10);
  EXPECT_EQ(rig.runs, 0);
  EXPECT_EQ(rig.finish(), Verdict::incomplete);
}

TEST(Automatic, ALastSessionWithoutWritesEndsWithItsClose) {
  Rig rig(MemoryTape().open(0).write(10, "Q").close(20).open(30).read(40, "hello"),
          with(OnReopen::automatic));
  rig.open().write("Q").wait(10).close().open().close();
  EXPECT_EQ(rig.runs, 1);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Automatic, AReopenWithNothingExchangedDoesNotSkipAQuestionWithoutAnswer) {
  Rig rig(MemoryTape().open(0).write(10, "Q").close(20).open(30).write(40, "R").read(50, "A"),
          with(OnReopen::automatic));
  rig.open().close().open().write("Q").close().open().write("R").wait(10);
  EXPECT_EQ(rig.read(), "A");
  EXPECT_EQ(rig.finish(), Verdict::pass);
}

TEST(Automatic, PendingReadsSurviveANoOpReopen) {
  Rig rig(MemoryTape().open(0).read(5'000, "hello").close(9'000).open(10'000).read(11'000, "again"));
  rig.open().wait(1'000).close().wait(50'000).open().wait(4'999);
  EXPECT_EQ(rig.read(), "");
  rig.wait(1);
  EXPECT_EQ(rig.read(), "hello");
  rig.close().open().wait(1'000);
  EXPECT_EQ(rig.read(), "again");
}

TEST(Automatic, ARecordedSessionWithNothingInItIsConsumed) {
  const auto tape =
      MemoryTape().open(0).close(1'000).open(2'000).write(3'000, "Q").read(4'000, "A").close(5'000);
  Rig rig(tape, with(OnReopen::automatic));
  rig.open().close().open().write("Q").wait(1'000);
  EXPECT_EQ(rig.read(), "A");
  rig.close();
  EXPECT_EQ(rig.runs, 1);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Automatic, APartialSessionIsAMismatchInTheNext) {
  const auto tape = MemoryTape()
                        .open(0)
                        .write(1'000, "Q1")
                        .read(2'000, "A1")
                        .write(3'000, "Q2")
                        .close(4'000)
                        .open(5'000)
                        .write(6'000, "Q3")
                        .read(7'000, "A3");
  Rig rig(tape, with(OnReopen::automatic));
  rig.open().write("Q1").wait(5'000).close().open();
  EXPECT_EQ(rig.runs, 0);
  rig.write("Q3");
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.report->mismatch->offset, 3U);
  EXPECT_EQ(as_text(rig.report->mismatch->expected), "2Q3");
}

TEST(Automatic, AfterAPartialSessionWarnGoesOnInTheNextAndTellsWhatIsMissing) {
  const auto tape = MemoryTape()
                        .open(0)
                        .write(1'000, "Q1")
                        .read(2'000, "A1")
                        .write(3'000, "Q2")
                        .close(4'000)
                        .open(5'000)
                        .write(6'000, "Q3")
                        .read(7'000, "A3");
  Rig rig(tape, with(OnReopen::automatic, OnMismatch::warn));
  rig.open().write("Q1").wait(5'000).close().open().write("Q3").wait(1'000);
  EXPECT_EQ(rig.read(), "A1A3");
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::incomplete);
  EXPECT_EQ(rig.report->next_expected_offset, 2U);
  EXPECT_EQ(as_text(rig.report->next_expected), "Q2Q3");
  EXPECT_EQ(rig.report->from_driver_matched, 4U);
}

TEST(Automatic, StrictnessZeroGoesOnAfterAPartialSession) {
  ReplayConfig config;
  config.strictness = 0;
  Rig rig(three_sessions(), config);
  rig.open().write("x").close().open().write("y1").wait(1'000);
  EXPECT_EQ(rig.read(), "A1");
  rig.close().open().write("Q2").wait(1'000);
  EXPECT_EQ(rig.read(), "A2");
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.runs, 1);
}

TEST(Automatic, AnOpenIsAGateAndTimesWhatFollows) {
  Rig rig(MemoryTape().open(0).write(10, "Q").close(20).open(1'000'000).read(1'030'000, "hello"),
          with(OnReopen::automatic));
  rig.open().write("Q").wait(5'000'000);
  EXPECT_EQ(rig.read(), "");
  rig.close().wait(100).open().wait(29'999);
  EXPECT_EQ(rig.read(), "");
  rig.wait(1);
  EXPECT_EQ(rig.read(), "hello");
}

TEST(Automatic, ADriverThatDoesNotReopenGoesOnByWriting) {
  Rig rig(three_sessions(), with(OnReopen::automatic));
  rig.open();
  for (int i = 0; i < 3; ++i) {
    rig.write("Q" + std::to_string(i)).wait(1'000);
    EXPECT_EQ(rig.read(), "A" + std::to_string(i));
  }
  rig.close();
  EXPECT_EQ(rig.runs, 1);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Automatic, ReadsBetweenARecordedCloseAndOpenReachNobody) {
  Rig rig(MemoryTape()
              .open(0)
              .write(10, "Q")
              .read(20, "A")
              .close(30)
              .read(40, "noise")
              .open(50)
              .write(60, "R")
              .read(70, "B"));
  rig.open().write("Q").wait(1'000);
  EXPECT_EQ(rig.read(), "A");
  rig.close().open().write("R").wait(1'000);
  EXPECT_EQ(rig.read(), "B");
}

TEST(Automatic, TheCloseOfTheLastSessionEndsTheRun) {
  Rig rig(MemoryTape().open(0).write(10, "Q").close(20), with(OnReopen::automatic));
  rig.open().write("Q").close();
  EXPECT_EQ(rig.runs, 1);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Automatic, ASecondOpenerChangesNothing) {
  Rig rig(one_session());
  rig.open().write("Q").open().wait(1'000);
  EXPECT_EQ(rig.read(), "A");
  EXPECT_EQ(rig.runs, 0);
}

TEST(Rewind, TheEndOfARunIsToldBeforeTheNextBegins) {
  Rig rig(MemoryTape().read(0, "hello"));
  rig.open().read();
  rig.engine.on_close(rig.now());
  rig.engine.on_open(rig.now());
  const ReplayActions first = rig.engine.advance(rig.now());
  EXPECT_TRUE(first.run_ended);
  EXPECT_TRUE(first.deliver.empty());
  ASSERT_EQ(rig.engine.next_deadline(), rig.now());
  EXPECT_EQ(as_text(rig.engine.advance(rig.now()).deliver), "hello");
}

TEST(Rewind, EveryRunKnowsWhatTheTapeHolds) {
  Rig rig(one_session(), with(OnReopen::rewind));
  rig.open().write("Q").wait(1'000).close().open().close();
  EXPECT_EQ(rig.runs, 2);
  EXPECT_EQ(rig.report->to_driver_bytes, 0U);
  EXPECT_EQ(rig.report->to_driver_of, 1U);
  EXPECT_EQ(rig.report->from_driver_of, 1U);
}

TEST(Rewind, EveryCloseEndsTheRun) {
  Rig rig(three_sessions(), with(OnReopen::rewind));
  rig.open().write("Q0").wait(1'000).close();
  EXPECT_EQ(rig.runs, 1);
  EXPECT_EQ(rig.verdict(), Verdict::incomplete);
  rig.open().write("Q0").wait(1'000).close();
  EXPECT_EQ(rig.runs, 2);
  EXPECT_EQ(rig.read(), "A0A0");
}

TEST(Continue, TheNextOpenContinuesWhereItWas) {
  const auto tape = MemoryTape().write(1'000, "Q1").read(2'000, "A1").write(3'000, "Q2").read(4'000, "A2");
  Rig rig(tape, with(OnReopen::continue_));
  rig.open().write("Q1").wait(1'000).close();
  EXPECT_EQ(rig.runs, 0);
  rig.wait(1'000'000).open().write("Q2").wait(1'000);
  EXPECT_EQ(rig.read(), "A1A2");
  rig.close();
  EXPECT_EQ(rig.runs, 1);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  // Nothing is left, and it never rewinds.
  rig.open().wait(1'000).close();
  EXPECT_EQ(rig.read(), "");
  EXPECT_EQ(rig.runs, 1);
}

TEST(Continue, WhatIsWrittenBehindTheTapesEndIsExtra) {
  const auto tape = MemoryTape().write(1'000, "Q1").read(2'000, "A1").write(3'000, "Q2").read(4'000, "A2");
  for (const OnMismatch on_mismatch : {OnMismatch::warn, OnMismatch::fail, OnMismatch::resync}) {
    ReplayConfig config = with(OnReopen::continue_);
    config.on_mismatch = on_mismatch;
    Rig rig(tape, config);
    rig.open().write("Q1").wait(1'000).close().open().write("Q2").wait(1'000).close();
    ASSERT_EQ(rig.verdict(), Verdict::pass);
    EXPECT_EQ(rig.read(), "A1A2");
    for (int runs = 2; runs <= 3; ++runs) {
      rig.open().wait(1'000).close();
      EXPECT_EQ(rig.runs, runs - 1) << "an open alone is none";
      rig.open().write("Q1").wait(1'000).close();
      ASSERT_EQ(rig.runs, runs);
      EXPECT_EQ(rig.read(), "") << "of this session; it never rewinds";
      EXPECT_EQ(rig.verdict(), Verdict::extra);
      EXPECT_EQ(rig.report->from_driver_bytes, 2U);
      EXPECT_EQ(rig.report->from_driver_matched, 0U);
      ASSERT_TRUE(rig.report->mismatch);
      EXPECT_EQ(rig.report->mismatch->tape_offset, 4U);
    }
  }
}

TEST(Continue, AtStrictnessZeroNothingBehindTheEndIsExtra) {
  ReplayConfig config = with(OnReopen::continue_);
  config.strictness = 0;
  Rig rig(MemoryTape().write(1'000, "Q1").read(2'000, "A1"), config);
  rig.open().write("Q1").wait(1'000).close().open().write("Q1").wait(1'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Continue, ClosedTimeRunsOnForAStream) {
  MemoryTape tape;
  for (int i = 0; i < 10; ++i) tape.read(i * 10'000, std::to_string(i));
  Rig rig(std::move(tape), with(OnReopen::continue_));
  rig.open().until(25'000).close().until(55'000).open().until(200'000);
  EXPECT_EQ(rig.read(), "0126789");
}

TEST(Continue, ARecordedReopenIsTimedFromTheDriversOwn) {
  Rig rig(three_sessions(), with(OnReopen::continue_));
  for (int i = 0; i < 3; ++i) {
    rig.open().write("Q" + std::to_string(i)).wait(1'000).close().wait(5'000);
  }
  EXPECT_EQ(rig.read(), "A0A1A2");
  EXPECT_EQ(rig.runs, 1);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

}  // namespace
}  // namespace porttape::test
