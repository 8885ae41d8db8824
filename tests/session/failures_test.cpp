#include "libport/session/failures.hpp"

#include <algorithm>
#include <array>

#include <gtest/gtest.h>

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

const Instant kStart = Instant{} + std::chrono::hours(1);

TEST(Failures, EachTroubleIsNewsOnceInARow) {
  Failures failures;
  EXPECT_TRUE(failures.failed(kStart, "missing"));
  EXPECT_FALSE(failures.failed(kStart, "missing"));
  EXPECT_TRUE(failures.failed(kStart, "busy"));
  EXPECT_FALSE(failures.failed(kStart, "missing"));
  EXPECT_FALSE(failures.take_untold()) << "the row is not over";
  failures.worked();
  EXPECT_EQ(failures.take_untold(), 2U);
  EXPECT_FALSE(failures.take_untold());
  EXPECT_TRUE(failures.failed(kStart, "missing"));
}

TEST(Failures, TroublesThatNeverRepeatDoNotFillTheLogEither) {
  Failures failures;
  int told = 0;
  for (int n = 0; n < 100; ++n) told += failures.failed(kStart, std::to_string(n)) ? 1 : 0;
  EXPECT_EQ(told, 8);
}

TEST(Failures, ALineThatDiesAtOnceHasNotWorked) {
  Failures failures;
  EXPECT_TRUE(failures.failed(kStart, "lost"));
  for (Instant now = kStart; now < kStart + seconds(10); now += milliseconds(100)) {
    failures.up(now);
    EXPECT_FALSE(failures.failed(now + milliseconds(50), "lost"));
  }
}

TEST(Failures, ALineThatHeldHasWorked) {
  Failures failures;
  for (int n = 0; n < 3; ++n) {
    const Instant up = kStart + seconds(10 * n);
    failures.up(up);
    EXPECT_TRUE(failures.failed(up + kLineHeld, "lost")) << n;
  }
}

TEST(Failures, TheNextOpenWaitsTheLongerTheMoreHaveFailed) {
  Failures failures;
  EXPECT_LE(failures.may_open(), kStart);
  Instant now = kStart;
  Nanos waited{};
  for (int n = 0; n < 20; ++n) {
    failures.failed(now, "missing");
    const Nanos wait = failures.may_open() - now;
    EXPECT_GE(wait, waited);
    EXPECT_LE(wait, Failures::kLongestWait);
    waited = wait;
    now = failures.may_open();
  }
  EXPECT_EQ(waited, Failures::kLongestWait);
}

TEST(Failures, WhatIsTriedNowAndThenIsOpenedAtOnce) {
  Failures failures;
  for (int n = 0; n < 20; ++n) {
    const Instant now = kStart + seconds(2) * n;
    EXPECT_LE(failures.may_open(), now);
    failures.failed(now, "missing");
    EXPECT_LE(failures.may_open(), now + Failures::kFirstWait);
  }
}

TEST(Failures, ALineThatHeldALittleLessHasNotWorked) {
  Failures failures;
  EXPECT_TRUE(failures.failed(kStart, "lost"));
  failures.up(kStart);
  EXPECT_FALSE(failures.failed(kStart + kLineHeld - Nanos(1), "lost"));
}

TEST(Failures, HowLongItWasUpCountsOnce) {
  Failures failures;
  failures.up(kStart);
  EXPECT_TRUE(failures.failed(kStart + kLineHeld, "lost"));
  EXPECT_FALSE(failures.failed(kStart + 2 * kLineHeld, "lost")) << "it has not come up again";
}

// Fails so often, each time when it may be opened; gives how long it waits then.
Nanos wait_after(Failures& failures, int times) {
  Instant now = kStart;
  for (int n = 0; n < times; ++n) {
    now = std::max(now, failures.may_open());
    failures.failed(now, "missing");
  }
  return failures.may_open() - now;
}

TEST(Failures, TheFirstIsOpenedAtOnceAndThenTheWaitDoubles) {
  const std::array waits = {milliseconds(0), milliseconds(10), milliseconds(20), milliseconds(40)};
  for (int times = 1; times <= 4; ++times) {
    Failures failures;
    EXPECT_EQ(wait_after(failures, times), waits.at(static_cast<std::size_t>(times - 1))) << times;
  }
}

TEST(Failures, ALineThatHasWorkedIsOpenedAtOnceAndItsWaitsBeginAnew) {
  Failures failures;
  (void)wait_after(failures, 8);
  failures.worked();
  EXPECT_LE(failures.may_open(), kStart);
  EXPECT_FALSE(failures.in_a_row());
  EXPECT_FALSE(failures.repeats());
  EXPECT_EQ(wait_after(failures, 2), milliseconds(10));
}

// Its clock is younger than the longest wait.
TEST(Failures, OnAMachineThatHasJustStartedALineThatHasWorkedWaitsNoLongerEither) {
  Failures failures;
  for (int n = 0; n < 8; ++n) failures.failed(Instant{}, "missing");
  failures.worked();
  failures.failed(Instant{}, "missing");
  failures.failed(Instant{}, "missing");
  EXPECT_EQ(failures.may_open() - Instant{}, Failures::kFirstWait);
}

TEST(Failures, WhoComesASecondAfterItMightHaveBeenOpenedDoesNotWaitForLong) {
  Failures failures;
  (void)wait_after(failures, 5);
  Failures sooner = failures;
  const Instant later = failures.may_open() + Failures::kLongestWait;
  failures.failed(later, "missing");
  EXPECT_EQ(failures.may_open() - later, Failures::kFirstWait);
  sooner.failed(later - Nanos(1), "missing");
  EXPECT_GT(sooner.may_open() - later, Failures::kFirstWait);
}

TEST(Failures, OneThatWasToldIsNoRepetition) {
  Failures failures;
  EXPECT_FALSE(failures.in_a_row());
  failures.failed(kStart, "missing");
  EXPECT_TRUE(failures.in_a_row());
  EXPECT_FALSE(failures.repeats());
  failures.failed(kStart, "missing");
  EXPECT_TRUE(failures.repeats());
  failures.worked();
  failures.failed(kStart, "missing");
  failures.worked();
  EXPECT_EQ(failures.take_untold(), 1U) << "of both rows";
}

}  // namespace
}  // namespace porttape
