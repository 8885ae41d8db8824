// How long a driver takes from an answer to its next request.

#include "libport/replay/think_times.hpp"

#include <gtest/gtest.h>

namespace porttape {
namespace {

class ThinkTimerTest : public testing::Test {
 public:
  // An answer now; the next request was recorded so much later, and comes so much later.
  void exchange(std::int64_t recorded_us, std::int64_t real_us, double rate = 1.0) {
    timer.answered(tape_time_us(1000), now);
    timer.expect(end += 10, tape_time_us(1000 + recorded_us), ++number);
    timer.came(now + Micros{real_us}, rate);
  }

  ThinkTimer timer;
  Instant now{Nanos{5'000'000'000}};
  std::uint64_t end = 0;
  std::uint64_t number = 0;
};

TEST_F(ThinkTimerTest, WithoutAnyThereAreNone) {
  EXPECT_FALSE(timer.times().has_value());
  timer.came(now, 1.0);
  EXPECT_FALSE(timer.times().has_value());
}

TEST_F(ThinkTimerTest, TheMostIsTheFirstOfTheLongest) {
  exchange(100, 50);
  exchange(200, 300);
  exchange(300, 300);
  EXPECT_EQ(timer.times(), (ThinkTimes{.count = 3,
                                       .median = Micros{300},
                                       .most = Micros{300},
                                       .most_at = 2,
                                       .recorded_median = Micros{200},
                                       .recorded_most = Micros{300}}));
}

TEST_F(ThinkTimerTest, ThoseThatTookNoTimeAreTimesToo) {
  exchange(100, 0);
  EXPECT_EQ(timer.times()->most_at, 1U);
  EXPECT_EQ(timer.times()->most, Micros{0});
  exchange(100, -20);
  EXPECT_EQ(timer.times()->median, Micros{0}) << "written before the answer was there";
  EXPECT_EQ(timer.times()->most_at, 1U);
}

TEST_F(ThinkTimerTest, WhatWasRecordedIsAtTheRateOfTheReplay) {
  exchange(1000, 100, 4.0);
  EXPECT_EQ(timer.times()->recorded_most, Micros{250});
}

TEST_F(ThinkTimerTest, AnAnswerCountsForTheNextRequestAlone) {
  timer.answered(tape_time_us(0), now);
  timer.expect(10, tape_time_us(100), 1);
  timer.expect(20, tape_time_us(200), 1);
  EXPECT_EQ(timer.expected(), 10U);
  timer.came(now + Micros{5}, 1.0);
  EXPECT_EQ(timer.expected(), std::nullopt);
  timer.came(now + Micros{7}, 1.0);
  EXPECT_EQ(timer.times()->count, 1U);
}

TEST_F(ThinkTimerTest, WhatIsForgottenTellsNothing) {
  timer.answered(tape_time_us(0), now);
  timer.forget();
  timer.expect(10, tape_time_us(100), 1);
  EXPECT_EQ(timer.expected(), std::nullopt);
  timer.answered(tape_time_us(0), now);
  timer.expect(10, tape_time_us(100), 1);
  timer.forget();
  EXPECT_EQ(timer.expected(), std::nullopt);
}

}  // namespace
}  // namespace porttape
