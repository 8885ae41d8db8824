// A driver that flushes its line: what is due and unread is lost, the rest comes.

#include <gtest/gtest.h>

#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

Rig& flush(Rig& rig) {
  rig.engine.on_event(rig.now(), line::Flush{});
  return rig.settle();
}

TEST(Flush, DropsWhatIsDueAndNotDelivered) {
  for (const Timing timing : {Timing::reactive, Timing::recorded}) {
    ReplayConfig config;
    config.timing = timing;
    Rig rig(MemoryTape().write(0, "ask").read(1'000, "one").read(2'000, "two").read(9'000, "three"), config);
    rig.open().write("ask").blocked(true).until(5'000);
    flush(rig).blocked(false);
    EXPECT_EQ(rig.delivered, "");
    rig.until(20'000);
    EXPECT_EQ(rig.delivered, "three");
    EXPECT_EQ(rig.deliveries.at(0).us, 9'000);
    EXPECT_EQ(rig.finish(), Verdict::pass);
  }
}

TEST(Flush, LeavesWhatIsNotDueAndWhatAGateHolds) {
  Rig rig(MemoryTape().write(0, "ask").read(5'000, "one").write(6'000, "more").read(6'000, "two"));
  rig.open().write("ask");
  flush(rig).until(10'000);
  EXPECT_EQ(rig.read(), "one");
  flush(rig).write("more").wait(10);
  EXPECT_EQ(rig.read(), "two");
}

TEST(Flush, WhatAStandingClockHoldsIsNotDropped) {
  for (const Timing timing : {Timing::reactive, Timing::recorded, Timing::none}) {
    ReplayConfig config;
    config.timing = timing;
    Rig rig(MemoryTape().read(0, "one").read(2'000, "two").read(9'000, "three"), config);
    rig.stand().open();
    flush(rig).wait(50'000);
    flush(rig).stand(false).until(200'000);
    EXPECT_EQ(rig.delivered, "onetwothree");
  }
}

TEST(Flush, WhatWasDueBeforeTheClockStoodIsDropped) {
  Rig rig(MemoryTape().read(1'000, "one").read(2'000, "two").read(9'000, "three"));
  rig.open().blocked(true).until(5'000).stand();
  flush(rig).blocked(false).stand(false).until(200'000);
  EXPECT_EQ(rig.delivered, "three");
}

TEST(Flush, IsNoEndOfTheLine) {
  Rig rig(MemoryTape().open(0).write(0, "ask").read(1'000, "one").hang_up(2'000).close(2'000));
  rig.open().write("ask").blocked(true).until(5'000);
  flush(rig).blocked(false);
  EXPECT_EQ(rig.delivered, "");
  EXPECT_TRUE(rig.hung_up);
}

TEST(Flush, OneOnTheTapeDropsNothing) {
  Rig rig(MemoryTape()
              .write(0, "ask")
              .read(1'000, "one")
              .event(1'500, event::Flush{FlushQueue::in})
              .read(2'000, "two"));
  rig.open().write("ask").until(5'000);
  EXPECT_EQ(rig.delivered, "onetwo");
}

TEST(Flush, TheHalfCloseOfATapeIsPassedBy) {
  Rig rig(MemoryTape()
              .open(0)
              .write(0, "ask")
              .event(1, event::HalfClose{Side::driver})
              .read(1'000, "one")
              .close(2'000));
  rig.open().write("ask").end_writing().until(5'000);
  EXPECT_EQ(rig.delivered, "one");
  EXPECT_TRUE(rig.hung_up);
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

}  // namespace
}  // namespace porttape::test
