#include "libport/blocking/loop_wait.hpp"

#include <chrono>

#include <gtest/gtest.h>

namespace porttape {
namespace {

using std::chrono::milliseconds;

constexpr Micros kForever{-1};

class LoopWaitTest : public testing::Test {
 protected:
  Loop loop;
  LoopWait wait{loop};
  LoopWait::Call call{wait};
};

TEST_F(LoopWaitTest, EndsWhenTheConditionHolds) {
  bool rung = false;
  Timer bell(loop, [&] { rung = true; });
  bell.set_after(milliseconds(1));
  EXPECT_EQ(wait.until([&] { return rung; }, kForever), LoopWait::End::ready);
}

TEST_F(LoopWaitTest, DoesWhatIsDueEvenWithoutTime) {
  bool done = false;
  loop.post([&] { done = true; });
  EXPECT_EQ(wait.until([&] { return done; }, Micros{0}), LoopWait::End::ready);
  EXPECT_EQ(wait.until([] { return false; }, Micros{0}), LoopWait::End::timed_out);
}

TEST_F(LoopWaitTest, TimesOut) {
  const Instant start = loop.now();
  EXPECT_EQ(wait.until([] { return false; }, milliseconds(2)), LoopWait::End::timed_out);
  EXPECT_GE(loop.now() - start, milliseconds(2));
}

TEST_F(LoopWaitTest, StallsWhereNothingCanHappen) {
  EXPECT_EQ(wait.until([] { return false; }, kForever), LoopWait::End::stalled);
}

TEST_F(LoopWaitTest, ProgressBeginsTheTimeoutAgain) {
  const Instant start = loop.now();
  int beats = 0;
  Timer beat(loop, [&] {
    wait.progress();
    if (++beats < 3) beat.set_after(milliseconds(5));
  });
  beat.set_after(milliseconds(5));
  EXPECT_EQ(wait.until_or_quiet([] { return false; }, milliseconds(200)), LoopWait::End::timed_out);
  EXPECT_GE(loop.now() - start, milliseconds(210));
}

TEST_F(LoopWaitTest, LooksAtAConditionThatNoEventTellsOf) {
  int looks = 0;
  EXPECT_EQ(wait.until_seen([&] { return ++looks > 3; }, kForever), LoopWait::End::ready);
}

}  // namespace
}  // namespace porttape
