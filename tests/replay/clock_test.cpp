// The clock of a replay: a player's own, and one that several players share.

#include <gtest/gtest.h>

#include "libport/replay/replay_clock.hpp"
#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

constexpr Instant at_us(std::int64_t us) { return Instant{Nanos{us * 1000}}; }

TEST(ReplayClockTest, TheFirstSessionSetsASharedClockAndTheOthersJoin) {
  ReplayClock clock(2);
  EXPECT_FALSE(clock.runs());
  clock.join();
  clock.join();
  EXPECT_EQ(clock.begin_session(tape_time_us(100), at_us(1'000)).real(tape_time_us(300)), at_us(1'100));
  EXPECT_EQ(clock.begin_session(tape_time_us(700), at_us(9'000)).real(tape_time_us(300)), at_us(1'100));
  clock.leave();
  EXPECT_TRUE(clock.runs());
  clock.leave();
  EXPECT_FALSE(clock.runs());
  EXPECT_EQ(clock.begin_session(tape_time_us(100), at_us(9'000)).real(tape_time_us(300)), at_us(9'100));
}

TEST(ReplayClockTest, EachSessionSetsAClockOfItsOwn) {
  ReplayClock clock(1, ReplayClock::Sessions::set_it);
  (void)clock.begin_session(tape_time_us(0), at_us(1'000));
  EXPECT_EQ(clock.begin_session(tape_time_us(50), at_us(9'000)).real(tape_time_us(60)), at_us(9'010));
}

TEST(ReplayClockTest, ATapeThatBeganLaterHasItsPlaceOnTheClock) {
  ReplayClock clock(1);
  const ClockPlace first{clock, Micros{0}};
  const ClockPlace later{clock, Micros{500}};
  (void)first.begin_session(tape_time_us(0), at_us(1'000));
  EXPECT_EQ(later.begin_session(tape_time_us(0), at_us(9'000)).real(tape_time_us(20)), at_us(1'520));
  EXPECT_EQ(clock.timeline().anchor_tape(), tape_time_us(0));
  EXPECT_EQ(clock.timeline().anchor_real(), at_us(1'000));
}

TEST(ReplayClockTest, TapesBeginAsTheirZerosLie) {
  ReplayClock clock(1);
  const TapeZero first{"2024-05-06T07:08:09.000000Z", 5'000'000, "a"};
  EXPECT_EQ(clock.tape_begin(first), Micros{0});
  EXPECT_EQ(clock.tape_begin({"2000-01-01T00:00:00Z", 5'000'250, "a"}), Micros{250});
  EXPECT_EQ(clock.tape_begin({"2024-05-06T07:08:08.5Z", 0, "b"}), Micros{-500'000});
  EXPECT_EQ(clock.tape_begin({"", 0, ""}), Micros{0});
}

TEST(HandMovesTest, WhatWasMovedSinceThenIsAdded) {
  HandMoves moves;
  EXPECT_EQ(moves.after(at_us(5), Nanos{3'000}), at_us(8));
  moves.add(at_us(10), at_us(30));
  moves.add(at_us(40), at_us(41));
  EXPECT_EQ(moves.after(at_us(10), Nanos{3'000}), at_us(34)) << "both moves";
  EXPECT_EQ(moves.after(at_us(25), Nanos{3'000}), at_us(34)) << "what of the first lies behind it";
  EXPECT_EQ(moves.after(at_us(30), Nanos{3'000}), at_us(34))
      << "what happened behind the first has the second";
  EXPECT_EQ(moves.after(at_us(41), Nanos{3'000}), at_us(44));
  EXPECT_EQ(moves.after(at_us(10), Nanos::max()), Instant::max());
}

TEST(HandMovesTest, TheOldestAreKeptAsOneThatIsLater) {
  HandMoves moves;
  for (int n = 0; n < 1'000; ++n) moves.add(at_us(100 * n), at_us(100 * n + 10));
  EXPECT_EQ(moves.after(at_us(99'900), {}), at_us(99'910));
  EXPECT_EQ(moves.after(at_us(99'000), {}), at_us(99'100)) << "ten moves";
  EXPECT_EQ(moves.after(at_us(80'000), {}), at_us(89'370 + 630)) << "all that may have been since then";
}

TEST(SharedClock, TheLastRunThatEndsStopsIt) {
  ReplayClock clock(1);
  const Engine::Parts parts{.clock = &clock};
  const auto tape = MemoryTape().read(1'000, "a");
  Rig first(tape, recorded(), true, 64, parts);
  {
    Rig second(tape, recorded(), true, 64, parts);
    first.open();
    second.open();
    first.until(2'000).close();
    EXPECT_TRUE(clock.runs());
  }
  EXPECT_FALSE(clock.runs()) << "an engine that goes leaves it too";
  first.until(50'000).open().until(60'000);
  EXPECT_EQ(first.deliveries, (std::vector<Rig::Delivery>{{1'000, "a", {1}}, {51'000, "a", {1}}}));
}

TEST(SharedClock, TwoEnginesKeepOneAnchor) {
  ReplayClock clock(2);
  const Engine::Parts parts{.clock = &clock};
  const auto tape = MemoryTape().read(0, "a").read(20'000, "b").read(40'000, "c");
  Rig first(tape, recorded(), true, 64, parts);
  Rig second(tape, recorded(), true, 64, parts);
  first.open();
  const Instant anchor = clock.timeline().anchor_real();
  second.wait(7'000).open().until(30'000);  // what is due before its open comes with it
  first.until(30'000);
  EXPECT_EQ(clock.timeline().anchor_real(), anchor);
  EXPECT_EQ(first.deliveries,
            (std::vector<Rig::Delivery>{{0, "a", {1}}, {10'000, "b", {1}}, {20'000, "c", {1}}}));
  EXPECT_EQ(second.deliveries,
            (std::vector<Rig::Delivery>{{7'000, "a", {1}}, {10'000, "b", {1}}, {20'000, "c", {1}}}));
  first.finish();
  EXPECT_EQ(first.report->rate, 2);
}

TEST(SharedClock, AReopenDoesNotSetIt) {
  ReplayClock clock(1);
  const auto tape =
      MemoryTape().open(0).read(1'000, "a").close(2'000).open(50'000).read(51'000, "b").read(52'000, "c");
  Rig rig(tape, recorded(), true, 64, {.clock = &clock});
  rig.open().until(2'500).close().wait(1'000).open().until(60'000);
  EXPECT_EQ(rig.deliveries,
            (std::vector<Rig::Delivery>{{1'000, "a", {1}}, {51'000, "b", {1}}, {52'000, "c", {1}}}));
}

TEST(SharedClock, AGateOfOnePlayerMovesNoOther) {
  ReplayClock clock(1);
  const Engine::Parts parts{.clock = &clock};
  Rig asked(MemoryTape().write(1'000, "?").read(2'000, "!"), {}, true, 64, parts);
  Rig streams(MemoryTape().read(2'000, "a").read(9'000, "b"), {}, true, 64, parts);
  asked.open();
  streams.open();
  asked.wait(5'000).write("?").until(20'000);
  streams.until(20'000);
  EXPECT_EQ(asked.deliveries, (std::vector<Rig::Delivery>{{6'000, "!", {1}}}));
  EXPECT_EQ(streams.deliveries, (std::vector<Rig::Delivery>{{2'000, "a", {1}}, {9'000, "b", {1}}}));
}

}  // namespace
}  // namespace porttape::test
