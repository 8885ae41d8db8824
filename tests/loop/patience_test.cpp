#include "libport/loop/patience.hpp"

#include <algorithm>
#include <chrono>

#include <gtest/gtest.h>

namespace porttape {
namespace {

using std::chrono::microseconds;

void wait_shortly(Patience& patience, int times) {
  for (int i = 0; i < times; ++i) patience.waited(microseconds(30));
}

TEST(Patience, ExpectsNothingAtFirst) { EXPECT_FALSE(Patience().expects_soon(Instant{})); }

TEST(Patience, ExpectsTheNextEventSoonAfterARowOfShortWaits) {
  Patience patience;
  wait_shortly(patience, Patience::kShortWaitsInARow - 1);
  EXPECT_FALSE(patience.expects_soon(Instant{}));
  wait_shortly(patience, 1);
  EXPECT_TRUE(patience.expects_soon(Instant{}));
}

TEST(Patience, AWaitOfJustTheLimitIsShort) {
  Patience patience;
  for (int i = 0; i < Patience::kShortWaitsInARow; ++i) patience.waited(Patience::kShortWait);
  EXPECT_TRUE(patience.expects_soon(Instant{}));
}

TEST(Patience, APollThatKeepsTheProcessorJustShortOfTheLimitCostsNothing) {
  Patience patience;
  wait_shortly(patience, Patience::kShortWaitsInARow);
  const Instant now = Instant{} + Patience::kPreempted - Nanos{1};
  patience.polled(Instant{}, now);
  EXPECT_TRUE(patience.expects_soon(now));
}

TEST(Patience, AfterALostProcessorTheShortWaitsAreCountedAnew) {
  Patience patience;
  wait_shortly(patience, Patience::kShortWaitsInARow);
  patience.polled(Instant{}, Instant{} + Patience::kPreempted);
  const Instant rested = Instant{} + Patience::kPreempted + Patience::kFirstRest;
  wait_shortly(patience, Patience::kShortWaitsInARow - 1);
  EXPECT_FALSE(patience.expects_soon(rested));
  wait_shortly(patience, 1);
  EXPECT_TRUE(patience.expects_soon(rested));
}

TEST(Patience, OneLongWaitEndsIt) {
  Patience patience;
  wait_shortly(patience, Patience::kShortWaitsInARow);
  patience.waited(Patience::kShortWait + microseconds(1));
  EXPECT_FALSE(patience.expects_soon(Instant{}));
  wait_shortly(patience, Patience::kShortWaitsInARow - 1);
  EXPECT_FALSE(patience.expects_soon(Instant{}));
}

// `lines` that each send a piece in turn.
void take_turns(Patience& patience, int lines, int rounds) {
  for (int turn = 0; turn < lines * rounds; ++turn) {
    patience.came_from(10 + turn % lines);
    patience.waited(microseconds(30));
  }
}

TEST(Patience, ExpectsNothingSoonOfManyLines) {
  Patience two;
  take_turns(two, 4, 10);
  EXPECT_TRUE(two.expects_soon(Instant{}));
  Patience many;
  take_turns(many, 5, 10);
  EXPECT_FALSE(many.expects_soon(Instant{}));
}

TEST(Patience, RestsLongerEachTimeAPollLosesTheProcessor) {
  Patience patience;
  Instant now{};
  for (Nanos rest = Patience::kFirstRest; rest < Patience::kLongestRest * 2; rest *= 2) {
    wait_shortly(patience, Patience::kShortWaitsInARow);
    ASSERT_TRUE(patience.expects_soon(now));
    patience.polled(now, now + Patience::kPreempted);
    now += Patience::kPreempted;
    wait_shortly(patience, Patience::kShortWaitsInARow);
    const Nanos expected = std::min(rest, Patience::kLongestRest);
    EXPECT_FALSE(patience.expects_soon(now + expected - microseconds(1)));
    now += expected;
    EXPECT_TRUE(patience.expects_soon(now));
  }
}

TEST(Patience, APollWithoutInterruptionCostsNothing) {
  Patience patience;
  wait_shortly(patience, Patience::kShortWaitsInARow);
  patience.polled(Instant{}, Instant{} + microseconds(5));
  EXPECT_TRUE(patience.expects_soon(Instant{} + microseconds(5)));
}

void poll(Patience& patience, int times, bool met, Instant now) {
  for (int i = 0; i < times; ++i) patience.poll_ended(met, now);
}

TEST(Patience, PollsThatMostlyMissArePaused) {
  Patience patience;
  wait_shortly(patience, Patience::kShortWaitsInARow);
  Instant now{};
  for (Nanos pause = Patience::kFirstPause; pause < Patience::kLongestPause * 4; pause *= 2) {
    poll(patience, 7, true, now);
    EXPECT_TRUE(patience.expects_soon(now));
    poll(patience, 9, false, now);
    const Nanos expected = std::min(pause, Patience::kLongestPause);
    EXPECT_FALSE(patience.expects_soon(now + expected - microseconds(1)));
    now += expected;
    EXPECT_TRUE(patience.expects_soon(now));
  }
}

TEST(Patience, PollsThatPayGoOnAndMakeTheNextPauseShort) {
  Patience patience;
  wait_shortly(patience, Patience::kShortWaitsInARow);
  Instant now{};
  for (int i = 0; i < 5; ++i) {
    poll(patience, Patience::kPollsJudged, false, now);
    now += Patience::kLongestPause;
  }
  for (int i = 0; i < 100; ++i) poll(patience, 1, i % 2 == 0, now);
  EXPECT_TRUE(patience.expects_soon(now));
  poll(patience, Patience::kPollsJudged * 2, false, now);
  EXPECT_TRUE(patience.expects_soon(now + Patience::kFirstPause * 2));
}

}  // namespace
}  // namespace porttape
