#include "libport/session/session_end.hpp"

#include <chrono>

#include <gtest/gtest.h>

namespace porttape {
namespace {

using std::chrono::seconds;
using Step = SessionEnd::Step;
using Stop = SessionEnd::Stop;

constexpr EndLimits kLimits{.without_progress = seconds(5),
                            .completing = seconds(10),
                            .failed_step = seconds(1),
                            .at_once = seconds(0)};

TEST(SessionEnd, GoesThroughItsStepsOnceEach) {
  SessionEnd end(kLimits);
  EXPECT_TRUE(end.running());
  EXPECT_TRUE(end.begin());
  EXPECT_FALSE(end.begin());
  EXPECT_TRUE(end.takes_in()) << "what has come in by now is passed on";
  EXPECT_TRUE(end.send(Instant{}));
  EXPECT_FALSE(end.takes_in());
  EXPECT_TRUE(end.leave());
  EXPECT_TRUE(end.complete());
  EXPECT_FALSE(end.complete());
  EXPECT_TRUE(end.end());
  EXPECT_EQ(end.step(), Step::ended);
}

TEST(SessionEnd, NoStepLeadsBack) {
  SessionEnd end(kLimits);
  EXPECT_TRUE(end.complete());
  EXPECT_FALSE(end.begin());
  EXPECT_FALSE(end.send(Instant{}));
  EXPECT_FALSE(end.leave());
  EXPECT_EQ(end.step(), Step::completing);
}

TEST(SessionEnd, AFirstStopBeginsASecondGivesUp) {
  SessionEnd end(kLimits);
  EXPECT_EQ(end.stop(), Stop::begin);
  end.begin();
  EXPECT_EQ(end.completing_limit(), seconds(10));
  EXPECT_EQ(end.stop(), Stop::give_up);
  EXPECT_EQ(end.completing_limit(), seconds(0));
}

TEST(SessionEnd, AFirstStopWaitsForAnEndUnderWay) {
  SessionEnd end(kLimits);
  end.begin();
  EXPECT_EQ(end.stop(), Stop::wait);
  EXPECT_EQ(end.stop(), Stop::give_up);
  EXPECT_EQ(end.stop(), Stop::give_up);
}

TEST(SessionEnd, WaitsWhileThePeersRead) {
  const Instant start{};
  SessionEnd end(kLimits);
  end.begin();
  end.send(start);
  EXPECT_TRUE(end.waits_on(start, 100));
  EXPECT_TRUE(end.waits_on(start + seconds(4), 50));
  EXPECT_TRUE(end.waits_on(start + seconds(8), 50));
  EXPECT_FALSE(end.waits_on(start + seconds(9), 50));
}

TEST(SessionEnd, AFailedOneHasItsLimitWhateverIsRead) {
  const Instant start{};
  SessionEnd end(kLimits);
  end.fail();
  end.begin();
  end.send(start);
  EXPECT_TRUE(end.waits_on(start, 100));
  EXPECT_FALSE(end.waits_on(start + seconds(1), 50));
  EXPECT_EQ(end.completing_limit(), seconds(1));
}

TEST(SessionEnd, AStepIsTakenOnceAndAnEarlierOneNotAtAll) {
  SessionEnd end(kLimits);
  EXPECT_TRUE(end.begin());
  EXPECT_TRUE(end.send(Instant{}));
  EXPECT_FALSE(end.send(Instant{} + seconds(1)));
  EXPECT_FALSE(end.begin());
  EXPECT_TRUE(end.waits_on(Instant{} + seconds(4), std::nullopt));
  EXPECT_FALSE(end.waits_on(Instant{} + seconds(5), std::nullopt)) << "the first counts";
  EXPECT_TRUE(end.leave());
  EXPECT_FALSE(end.leave());
}

TEST(SessionEnd, BeforeItSendsNothingIsWaitedFor) {
  SessionEnd end(kLimits);
  EXPECT_FALSE(end.waits_on(Instant{}, 1));
  end.begin();
  EXPECT_FALSE(end.waits_on(Instant{}, 1));
}

TEST(SessionEnd, ASecondStopShortensAFailedOneToo) {
  SessionEnd end(kLimits);
  end.fail();
  end.begin();
  EXPECT_EQ(end.completing_limit(), seconds(1));
  end.stop();
  EXPECT_EQ(end.completing_limit(), seconds(1));
  end.stop();
  EXPECT_EQ(end.completing_limit(), seconds(0));
}

}  // namespace
}  // namespace porttape
