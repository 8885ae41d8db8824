// on-mismatch=resync: after a mismatch the tape goes on where it has what the driver wrote.

#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

using testing::HasSubstr;

ReplayConfig resync() {
  ReplayConfig config;
  config.on_mismatch = OnMismatch::resync;
  return config;
}

// Five exchanges, 10 ms apart; the answer comes 1 ms after its question.
MemoryTape five() {
  MemoryTape tape;
  tape.open(0);
  for (int i = 1; i <= 5; ++i) {
    const std::string number = std::to_string(i);
    tape.write(i * 10'000, "ask" + number + "\n").read(i * 10'000 + 1000, "answer" + number + "\n");
  }
  return tape.close(60'000);
}

std::string ask(Rig& rig, int i) {
  rig.write("ask" + std::to_string(i) + "\n").wait(1000);
  return rig.read();
}

TEST(Resync, WithoutAMismatchItIsAsEver) {
  Rig rig(five(), resync());
  rig.open();
  for (int i = 1; i <= 5; ++i) EXPECT_EQ(ask(rig, i), "answer" + std::to_string(i) + "\n");
  EXPECT_EQ(rig.close().verdict(), Verdict::pass);
}

TEST(Resync, RequestsThatAreLeftOutAreSkipped) {
  Rig rig(five(), resync());
  rig.open();
  EXPECT_EQ(ask(rig, 1), "answer1\n");
  EXPECT_EQ(ask(rig, 4), "answer4\n");
  EXPECT_EQ(ask(rig, 5), "answer5\n");
  EXPECT_EQ(rig.close().verdict(), Verdict::data_mismatch);
  ASSERT_EQ(rig.mismatches.size(), 1U);
  EXPECT_EQ(rig.mismatches.front().offset, 8U);
  EXPECT_EQ(rig.report->mismatch->went_on, "the tape goes on at 0.040000 s: 2 requests skipped");
  EXPECT_THAT(to_text(*rig.report),
              HasSubstr("  resync    the tape goes on at 0.040000 s: 2 requests skipped\n"));
}

TEST(Resync, WhatIsOnTheTapeBeforeIsAnsweredAgain) {
  Rig rig(five(), resync());
  rig.open();
  for (int i = 1; i <= 3; ++i) EXPECT_EQ(ask(rig, i), "answer" + std::to_string(i) + "\n");
  EXPECT_EQ(ask(rig, 2), "answer2\n");
  EXPECT_EQ(ask(rig, 3), "answer3\n");
  EXPECT_EQ(ask(rig, 4), "answer4\n");
  EXPECT_EQ(rig.close().verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.mismatches.size(), 1U);
  EXPECT_EQ(rig.report->mismatch->went_on, "the tape goes back 2 requests and on at 0.020000 s");
}

TEST(Resync, WhatIsNotOnTheTapeIsPassedOver) {
  Rig rig(five(), resync());
  rig.open();
  EXPECT_EQ(ask(rig, 1), "answer1\n");
  EXPECT_EQ(rig.write("what?\n").wait(100'000).read(), "");
  EXPECT_EQ(ask(rig, 2), "answer2\n");
  EXPECT_EQ(ask(rig, 3), "answer3\n");
  EXPECT_EQ(rig.close().verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.mismatches.size(), 1U);
  EXPECT_EQ(rig.report->mismatch->went_on, "the tape goes on at 0.020000 s, with the request that was next");
}

TEST(Resync, BytesInFrontOfARequestArePassedOver) {
  Rig rig(five(), resync());
  rig.open().write("\nask1\n").wait(1000);
  EXPECT_EQ(rig.read(), "answer1\n");
  EXPECT_EQ(ask(rig, 2), "answer2\n");
  EXPECT_EQ(rig.mismatches.size(), 1U);
}

TEST(Resync, EachFurtherJumpIsAMismatch) {
  Rig rig(five(), resync());
  rig.open();
  EXPECT_EQ(ask(rig, 2), "answer2\n");
  EXPECT_EQ(ask(rig, 5), "answer5\n");
  EXPECT_EQ(rig.write("?\n").wait(100'000).read(), "");
  EXPECT_EQ(ask(rig, 1), "answer1\n");
  ASSERT_EQ(rig.mismatches.size(), 3U);
  EXPECT_EQ(rig.mismatches[1].offset, 5U);
  EXPECT_EQ(as_text(rig.mismatches[1].expected), "ask3\n");
  EXPECT_EQ(as_text(rig.mismatches[1].got), "ask5\n");
  EXPECT_EQ(rig.mismatches[1].went_on, "the tape goes on at 0.050000 s: 2 requests skipped");
  EXPECT_EQ(rig.mismatches[2].offset, 10U);
}

TEST(Resync, HoweverTheDriverCutsItsWrites) {
  for (std::size_t piece = 1; piece < 4; ++piece) {
    Rig rig(five(), resync(), true, piece);
    rig.open().write_bytewise("ask1\n").wait(1000);
    rig.write_bytewise("ask3\n").wait(1000);
    rig.write("ask4\nas").write("k5\n").wait(10'000);
    EXPECT_EQ(rig.delivered, "answer1\nanswer3\nanswer4\nanswer5\n");
    EXPECT_EQ(rig.mismatches.size(), 1U);
  }
}

TEST(Resync, AnswersThatAreOnTheirWayComeFirst) {
  Rig rig(MemoryTape().write(0, "a").read(5000, "A").write(6000, "b").read(7000, "B").write(8000, "c").read(
              9000, "C"),
          resync());
  rig.open().write("ac").wait(4999);
  EXPECT_EQ(rig.read(), "");
  rig.wait(10'000);
  EXPECT_EQ(rig.read(), "AC");
}

TEST(Resync, WhatComesBehindTheEndOfTheTapeIsFoundBefore) {
  Rig rig(five(), resync());
  rig.open();
  for (int i = 1; i <= 5; ++i) (void)ask(rig, i);
  EXPECT_EQ(ask(rig, 5), "answer5\n");
  EXPECT_EQ(rig.close().verdict(), Verdict::extra);
}

TEST(Resync, TheNextSessionIsCheckedAsEver) {
  MemoryTape tape;
  tape.open(0).write(1000, "a").read(2000, "A").write(3000, "b").read(4000, "B").close(5000);
  tape.open(10'000)
      .read(10'500, ">")
      .write(11'000, "c")
      .read(12'000, "C")
      .write(13'000, "d")
      .read(14'000, "D");
  Rig rig(tape, resync());
  rig.open().write("b").wait(1000);
  EXPECT_EQ(rig.read(), "B");
  rig.close().open().wait(500);
  EXPECT_EQ(rig.read(), ">");
  EXPECT_EQ(rig.write("c").wait(1000).read(), "C");
  EXPECT_EQ(rig.write("d").wait(1000).read(), "D");
  EXPECT_EQ(rig.mismatches.size(), 1U);
  EXPECT_EQ(rig.close().verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.report->sessions_made, 2U);
}

TEST(Resync, ACloseBeforeTheTapeIsReadThroughForgetsTheQuestion) {
  MemoryTape tape;
  tape.open(0);
  for (int i = 0; i < 10'000; ++i) tape.write(i * 100, "q" + std::to_string(i) + ";").read(i * 100 + 50, "a");
  ReplayConfig config = resync();
  config.on_reopen = OnReopen::continue_;
  Rig rig(tape, config);
  rig.engine.on_open(rig.now());
  rig.engine.on_write(rig.now(), as_bytes("q9999;"));
  rig.engine.on_close(rig.now());
  rig.open().write("q77;").wait(50);
  EXPECT_EQ(rig.read(), "a");
}

TEST(Resync, ALongTapeIsReadInSlicesWhileTheDriverWaits) {
  MemoryTape tape;
  for (int i = 0; i < 10'000; ++i) tape.write(i * 100, "q" + std::to_string(i) + ";").read(i * 100 + 50, "a");
  Rig rig(tape, resync());
  rig.engine.on_open(rig.now());
  rig.engine.on_write(rig.now(), as_bytes("q9999;"));
  EXPECT_LE(*rig.engine.next_deadline(), rig.now());
  rig.settle().wait(50);
  EXPECT_EQ(rig.read(), "a");
}

}  // namespace
}  // namespace porttape::test
