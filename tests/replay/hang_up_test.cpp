// A device that goes away, and a driver that ends only its own direction.

#include <gtest/gtest.h>

#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

ReplayConfig with(Timing timing) {
  ReplayConfig config;
  config.timing = timing;
  return config;
}

// A device that closes the connection after each answer, twice.
MemoryTape two_calls() {
  MemoryTape tape;
  for (const std::int64_t start : {0, 1'000'000}) {
    tape.open(start).write(start + 1'000, "Q").read(start + 2'000, "A").hang_up(start + 2'500);
    tape.close(start + 3'000);
  }
  return tape;
}

TEST(HangUp, ComesTheRecordedTimeAfterTheAnswerInEverySession) {
  Rig rig(two_calls());
  for (int i = 0; i < 2; ++i) {
    rig.hung_up = false;
    rig.open().wait(50'000).write("Q").wait(1'499);
    EXPECT_EQ(rig.read(), "A");
    EXPECT_FALSE(rig.hung_up);
    rig.wait(1);
    EXPECT_TRUE(rig.hung_up);
    rig.close().wait(100);
  }
  EXPECT_EQ(rig.runs, 1);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(HangUp, WaitsForWhatTheDriverWroteBeforeIt) {
  Rig rig(MemoryTape().open(0).write(1'000, "QUIT").hang_up(1'200).close(2'000));
  rig.open().wait(10'000'000);
  EXPECT_FALSE(rig.hung_up);
  rig.write("QUIT").wait(199);
  EXPECT_FALSE(rig.hung_up);
  rig.wait(1);
  EXPECT_TRUE(rig.hung_up);
  EXPECT_EQ(rig.close().verdict(), Verdict::pass);
}

TEST(HangUp, WaitsWhileTheLineTakesNothing) {
  Rig rig(two_calls());
  rig.open().write("Q").wait(1'000).blocked(true).wait(10'000);
  EXPECT_FALSE(rig.hung_up);
  rig.blocked(false);
  EXPECT_TRUE(rig.hung_up);
}

TEST(HangUp, ByTheRecordedClockComesAtItsTime) {
  Rig rig(two_calls(), with(Timing::recorded));
  rig.open().wait(2'499);
  EXPECT_FALSE(rig.hung_up);
  rig.wait(1);
  EXPECT_TRUE(rig.hung_up);
}

TEST(HangUp, WithoutDelaysComesAtOnce) {
  Rig rig(two_calls(), with(Timing::none));
  rig.open().write("Q");
  EXPECT_EQ(rig.read(), "A");
  EXPECT_TRUE(rig.hung_up);
}

TEST(HangUp, AnEarlierCloseOfTheDriverIsTheRecordedOne) {
  Rig rig(two_calls());
  rig.open().write("Q").wait(1'000).close();
  EXPECT_FALSE(rig.hung_up);
  rig.open().write("Q").wait(1'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.runs, 1);
}

TEST(HangUp, WhatTheDriverWroteToADeviceThatWasGoneIsNotCompared) {
  Rig rig(two_calls());
  for (int i = 0; i < 2; ++i) {
    rig.hung_up = false;
    rig.open().write("Q and more than the device took").wait(1'500);
    EXPECT_EQ(rig.read(), "A");
    EXPECT_TRUE(rig.hung_up);
    rig.write("and more").close();
  }
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

// Its clock goes on, and the line breaks before a late driver has written all.
TEST(HangUp, ByTheRecordedClockALateDriverIsStillCompared) {
  MemoryTape tape;
  tape.open(0).write(1'000, "A").read(2'000, "1").write(3'000, "B").read(4'000, "2");
  tape.hang_up(5'000).close(6'000).open(9'000).write(10'000, "C").read(11'000, "3").close(12'000);
  const auto late = [&tape](std::string_view text) {
    Rig rig(tape, with(Timing::recorded));
    rig.open().wait(1'000).write("A").wait(100'000);
    EXPECT_TRUE(rig.hung_up);
    rig.write(text).close().wait(1'000).open().wait(1'000).write("C").wait(10'000).close();
    EXPECT_EQ(rig.delivered, "123");
    return rig.verdict();
  };
  EXPECT_EQ(late("B"), Verdict::pass);
  EXPECT_EQ(late("B and more than the device took"), Verdict::pass);
  EXPECT_EQ(late("X"), Verdict::data_mismatch);
}

TEST(HangUp, OfADeviceThatWasNeverThereJudgesNothing) {
  Rig rig(MemoryTape().open(0).hang_up(300).close(400).open(1'000).write(1'100, "Q").read(1'200, "A"));
  rig.open().write("anybody there?").wait(300);
  EXPECT_TRUE(rig.hung_up);
  rig.close().open().write("Q").wait(100);
  EXPECT_EQ(rig.read(), "A");
  EXPECT_EQ(rig.close().verdict(), Verdict::pass);
}

// A device that hangs up, comes back, and speaks first.
MemoryTape speaks_again() {
  MemoryTape tape;
  tape.open(0).read(1'000, "A").hang_up(2'000).close(2'500);
  return tape.open(10'000).read(12'000, "B").write(13'000, "Q").read(14'000, "C").close(20'000);
}

TEST(HangUp, NothingComesBeforeTheDriverOpensItsLineAnew) {
  ReplayConfig config = with(Timing::reactive);
  config.strictness = 0;  // a driver that is silent is not waited for
  Rig rig(speaks_again(), config);
  rig.open().wait(2'000);
  EXPECT_EQ(rig.read(), "A");
  ASSERT_TRUE(rig.hung_up);
  rig.wait(60'000'000);
  EXPECT_EQ(rig.read(), "");
  rig.close().open().wait(2'000);
  EXPECT_EQ(rig.read(), "B");
  rig.write("Q").wait(1'000);
  EXPECT_EQ(rig.read(), "C");
  EXPECT_EQ(rig.close().verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->reads_excused, 0);
}

TEST(HangUp, NothingComesToADriverThatHasMadeAMistakeBefore) {
  Rig rig(MemoryTape()
              .open(0)
              .write(1'000, "Q")
              .read(2'000, "A")
              .hang_up(3'000)
              .close(4'000)
              .open(10'000)
              .read(11'000, "B")
              .close(12'000));
  rig.open().write("X").wait(60'000'000);
  ASSERT_TRUE(rig.hung_up);
  EXPECT_EQ(rig.read(), "A");
  rig.close().open().wait(1'000);
  EXPECT_EQ(rig.read(), "B");
}

TEST(HangUp, ByTheRecordedClockTheNextSessionWaitsForTheDriversOpen) {
  Rig rig(speaks_again(), with(Timing::recorded));
  rig.open().wait(60'000'000);
  EXPECT_EQ(rig.read(), "A");
  ASSERT_TRUE(rig.hung_up);
  rig.close().open().wait(1'999);
  EXPECT_EQ(rig.read(), "");
  rig.wait(1);
  EXPECT_EQ(rig.read(), "B");
  rig.wait(1'000).write("Q").wait(1'000);
  EXPECT_EQ(rig.read(), "C");
  EXPECT_EQ(rig.close().verdict(), Verdict::pass);
}

TEST(HangUp, WhatStandsBehindItInItsSessionReachesNobody) {
  for (const Timing timing : {Timing::reactive, Timing::none, Timing::recorded}) {
    Rig rig(MemoryTape()
                .open(0)
                .hang_up(1'000)
                .read(2'000, "A")
                .half_close(3'000, Side::device)
                .hang_up(3'500)
                .close(4'000)
                .open(5'000)
                .read(6'000, "B")
                .close(7'000),
            with(timing), true, std::numeric_limits<std::size_t>::max(), kSocket);
    rig.open().wait(60'000'000);
    EXPECT_TRUE(rig.hung_up);
    EXPECT_EQ(rig.read(), "");
    EXPECT_FALSE(rig.ended);
    rig.close().open().wait(1'000);
    EXPECT_EQ(rig.read(), "B");
    EXPECT_EQ(rig.close().report->reads_excused, 1);
  }
}

TEST(HangUp, TheNextLoopWaitsForTheDriversOpen) {
  for (const Timing timing : {Timing::reactive, Timing::none, Timing::recorded}) {
    ReplayConfig config = with(timing);
    config.loops = 3;
    Rig rig(MemoryTape().open(0).read(1'000, "A").hang_up(2'000).close(3'000), config);
    for (int loop = 0; loop < 3; ++loop) {
      rig.hung_up = false;
      rig.open().wait(60'000'000);
      EXPECT_EQ(rig.read(), "A");
      EXPECT_TRUE(rig.hung_up);
      rig.close();
    }
    EXPECT_EQ(rig.verdict(), Verdict::pass);
    EXPECT_EQ(rig.runs, 1);
  }
}

TEST(HangUp, OfADriverThatHasEndedItsWritingComesAfterTheLastAnswer) {
  Rig rig(MemoryTape().open(0).write(1'000, "Q").read(2'000, "A").read(9'000, "B").close(10'000));
  rig.open().write("Q").end_writing().wait(7'999);
  EXPECT_EQ(rig.read(), "A");
  EXPECT_FALSE(rig.hung_up);
  rig.wait(1);
  EXPECT_EQ(rig.read(), "B");
  EXPECT_TRUE(rig.hung_up);
  EXPECT_EQ(rig.close().verdict(), Verdict::pass);
}

TEST(HangUp, OfADriverThatHasEndedComesToOneThatHasNoRunLeft) {
  ReplayConfig config;
  config.on_reopen = OnReopen::continue_;
  Rig rig(MemoryTape().open(0).write(1'000, "Q").read(2'000, "A").close(3'000), config);
  rig.open().write("Q").wait(1'000).close();
  ASSERT_EQ(rig.verdict(), Verdict::pass);
  rig.open().write("more");
  EXPECT_FALSE(rig.hung_up);
  rig.end_writing();
  EXPECT_TRUE(rig.hung_up);
}

TEST(HangUp, OfADriverThatHasEndedAndOwesAWriteComesAtOnce) {
  Rig rig(MemoryTape().open(0).write(1'000, "Q").read(2'000, "A").close(10'000));
  rig.open().end_writing();
  EXPECT_TRUE(rig.hung_up) << "nothing can come any more";
  EXPECT_EQ(rig.close().verdict(), Verdict::incomplete);
}

TEST(HangUp, ByTheRecordedClockARunEndsNotBeforeTheTapesLastClose) {
  ReplayConfig config = with(Timing::recorded);
  config.at_end = AtEnd::hangup;
  Rig rig(MemoryTape().open(0).read(1'000, "A").close(50'000), config);
  rig.open().until(49'999);
  EXPECT_EQ(rig.read(), "A");
  EXPECT_FALSE(rig.hung_up);
  rig.until(50'000);
  EXPECT_TRUE(rig.hung_up);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(HangUp, ALineThatEndsBehindARunIsNoNewsForTheNextOne) {
  ReplayConfig config;
  config.on_mismatch = OnMismatch::fail;
  Rig rig(MemoryTape().open(0).write(1'000, "Q").read(2'000, "A").close(3'000), config);
  rig.open().write("X");
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  rig.line_ended().close().wait(1'000);
  EXPECT_EQ(rig.runs, 1);
  rig.open().write("Q").wait(1'000);
  EXPECT_EQ(rig.read(), "A");
  rig.close();
  EXPECT_EQ(rig.runs, 2);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

}  // namespace
}  // namespace porttape::test
