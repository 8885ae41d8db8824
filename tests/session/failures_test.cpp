#include "libport/session/failures.hpp"

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

}  // namespace
}  // namespace porttape
