#include "libport/port/lane.hpp"

#include <string>

#include <gtest/gtest.h>

#include "tests/support/manual_clock.hpp"
#include "tests/support/port_log.hpp"

namespace porttape {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;

class LaneTest : public testing::Test {
 protected:
  LaneTest()
      : lane(loop, {.open = [this] { return open; },
                    .pass = [this](ByteView bytes) { told += as_text(bytes); },
                    .given_up = [this](std::size_t bytes) { told += "-" + std::to_string(bytes); },
                    .less = [this] { told += "|"; }}) {}
  void put(const char* text, Nanos delay = {}) { lane.put(as_bytes(text), loop.now() + delay); }
  void put_event(Instant waits_until = Instant::max()) {
    lane.put([this] { told += "!"; }, waits_until);
  }

  ManualClock clock;
  Loop loop{clock};
  bool open = true;
  std::string told;
  Lane lane;
};

TEST_F(LaneTest, HoldsNothingThatIsDue) {
  put("a");
  put_event();
  EXPECT_EQ(told, "a!");
  EXPECT_TRUE(lane.empty());
  EXPECT_FALSE(lane.next_due().has_value());
}

TEST_F(LaneTest, DoesWhatItHoldsWhenItIsTime) {
  put("a", milliseconds(1));
  put_event();
  EXPECT_TRUE(let_pass(loop, clock, hours(1), [this] { return lane.empty(); }));
  EXPECT_EQ(told, "a!|");
}

TEST_F(LaneTest, NothingOvertakesWhatWasPutSooner) {
  put("a", hours(2));
  put_event();
  put("b");
  put("c", hours(1));
  EXPECT_EQ(told, "");
  EXPECT_EQ(lane.bytes(), 3U);
  EXPECT_GT(*lane.next_due(), loop.now() + hours(1));
  lane.let_go();
  EXPECT_EQ(told, "a!bc|");
}

TEST_F(LaneTest, WhatIsLetGoWaitsForNoMoment) {
  put("a", hours(1));
  put("b", hours(2));
  lane.run();
  EXPECT_EQ(told, "");
  lane.let_go();
  EXPECT_EQ(told, "ab|");
  EXPECT_FALSE(lane.next_due().has_value());
  put("c", hours(1));
  EXPECT_EQ(lane.bytes(), 1U) << "what comes later is held";
}

TEST_F(LaneTest, InAHurryNothingIsHeld) {
  put("a", hours(1));
  lane.hurry(true);
  put("b", hours(1));
  lane.hurry(false);
  put("c", hours(1));
  EXPECT_EQ(told, "a|b");
}

TEST_F(LaneTest, BytesAndTheEventsBehindThemWaitWhileClosed) {
  open = false;
  put_event();
  put("a");
  put_event();
  EXPECT_EQ(told, "!");
  EXPECT_FALSE(lane.next_due().has_value());
  lane.let_go();
  EXPECT_EQ(told, "!");
  open = true;
  lane.run();
  EXPECT_EQ(told, "!a!|");
}

TEST_F(LaneTest, AnEventThatWaitsNoLongerGivesUpTheBytesBeforeIt) {
  open = false;
  put("abc");
  put_event(loop.now() + milliseconds(1));
  put("d");
  EXPECT_TRUE(let_pass(loop, clock, hours(1), [this] { return !told.empty(); }));
  EXPECT_EQ(told, "-3!|");
  EXPECT_EQ(lane.bytes(), 1U);
}

TEST_F(LaneTest, ADropLeavesNothingButTellsTheEvents) {
  put("abc", hours(1));
  put_event();
  put("d");
  EXPECT_EQ(lane.drop(), 4U);
  EXPECT_EQ(told, "!");
  EXPECT_TRUE(lane.empty());
  EXPECT_FALSE(lane.next_due().has_value());
}

TEST_F(LaneTest, WhatItCallsMayDropAll) {
  Lane own(loop, {.open = [] { return true; },
                  .pass =
                      [&](ByteView bytes) {
                        told += as_text(bytes);
                        (void)own.drop();
                      },
                  .given_up = [](std::size_t) {},
                  .less = [this] { told += "|"; }});
  own.put(as_bytes("a"), loop.now() + hours(1));
  own.put(as_bytes("b"), {});
  own.let_go();
  EXPECT_EQ(told, "a");
}

TEST_F(LaneTest, ThatThereIsLessIsToldOnce) {
  put("a", hours(1));
  lane.let_go();
  EXPECT_EQ(told, "a|");
  lane.run();
  EXPECT_EQ(told, "a|");
}

TEST_F(LaneTest, WhatIsDroppedIsNotToldAsLess) {
  put("a", hours(1));
  EXPECT_EQ(lane.drop(), 1U);
  lane.run();
  EXPECT_EQ(told, "");
}

}  // namespace
}  // namespace porttape
