#include "libport/loop/timer.hpp"

#include <chrono>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/manual_clock.hpp"
#include "tests/support/port_log.hpp"

namespace porttape {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;

TEST(Timer, NeverFiresEarly) {
  Loop loop;
  const Instant when = loop.now() + milliseconds(3);
  Instant fired{};
  Timer timer(loop, [&loop, &fired] { fired = loop.now(); });
  timer.set(when);
  loop.run();
  EXPECT_GE(fired, when);
}

TEST(Timer, TheLastMomentSetCounts) {
  Loop loop;
  int fired = 0;
  Timer timer(loop, [&fired] { ++fired; });
  timer.set_after(milliseconds(1));
  timer.set_after(milliseconds(2));
  loop.run();
  EXPECT_EQ(fired, 1);
  EXPECT_FALSE(timer.due().has_value());
}

TEST(Timer, CancelledNeverFires) {
  Loop loop;
  int fired = 0;
  Timer timer(loop, [&fired] { ++fired; });
  timer.set_after(milliseconds(1));
  timer.cancel();
  loop.run();
  EXPECT_EQ(fired, 0);
}

TEST(Timer, CancelledWhileAnotherWaitsItLeavesThatOneItsMoment) {
  Loop loop;
  std::string fired;
  Timer first(loop, [&fired] { fired += "first"; });
  Timer second(loop, [&fired] { fired += "second"; });
  first.set_after(milliseconds(1));
  second.set_after(milliseconds(3));
  const std::optional<Instant> when = second.due();
  first.cancel();
  loop.run();
  EXPECT_EQ(fired, "second");
  EXPECT_GE(loop.now(), when);
}

TEST(Timer, MayBeDestroyedByItsOwnCallback) {
  Loop loop;
  std::unique_ptr<Timer> timer;
  timer = std::make_unique<Timer>(loop, [&timer] { timer.reset(); });
  timer->set_after(milliseconds(1));
  loop.run();
  EXPECT_EQ(timer, nullptr);
}

TEST(Timer, EqualMomentsComeInTheOrderInWhichTheyWereSet) {
  Loop loop;
  std::string order;
  const Instant when = loop.now() + milliseconds(1);
  Timer first(loop, [&order] { order += "first "; });
  Timer second(loop, [&order] { order += "second "; });
  Timer sooner(loop, [&order] { order += "sooner "; });
  second.set(when + milliseconds(1));
  first.set(when);
  second.set(when);
  sooner.set(when - milliseconds(1));
  loop.run();
  EXPECT_EQ(order, "sooner first second ");
}

TEST(Timer, OneThatACallbackCancelsDoesNotCome) {
  Loop loop;
  int fired = 0;
  const Instant when = loop.now() + milliseconds(1);
  Timer second(loop, [&fired] { ++fired; });
  Timer first(loop, [&second] { second.cancel(); });
  first.set(when);
  second.set(when);
  loop.run();
  EXPECT_EQ(fired, 0);
}

TEST(Timer, AnExceptionOutOfOneDoesNotLoseTheOthers) {
  Loop loop;
  std::string order;
  const Instant when = loop.now() + milliseconds(1);
  Timer first(loop, [] { throw std::runtime_error("first"); });
  Timer second(loop, [&order] { order += "second "; });
  Timer later(loop, [&order] { order += "later "; });
  first.set(when);
  second.set(when);
  later.set(when + milliseconds(1));
  EXPECT_THROW(loop.run(), std::runtime_error);
  loop.run();
  EXPECT_EQ(order, "second later ");
}

TEST(Timer, MayGoWithAHandlerThatTheLoopNeverRan) {
  auto loop = std::make_unique<Loop>();
  const auto timer = std::make_shared<Timer>(*loop, [] {});
  timer->set_after(milliseconds(1));
  loop->post([kept = std::make_shared<Timer>(*loop, [] {})] { kept->cancel(); });
  std::weak_ptr<Timer> gone;
  {
    const auto another = std::make_shared<Timer>(*loop, [] {});
    another->set_after(milliseconds(1));
    gone = another;
    loop->post([another] { another->cancel(); });
  }
  timer->cancel();
  loop.reset();
  EXPECT_TRUE(gone.expired());
}

TEST(ManualClock, ATimerComesWhenTheClockIsMovedToItsMoment) {
  ManualClock clock;
  Loop loop(clock);
  std::vector<Instant> fired;
  Timer timer(loop, [&] { fired.push_back(loop.now()); });
  const Instant begin = clock.now();
  timer.set_after(hours(1));
  EXPECT_EQ(loop.next_timer(), begin + hours(1));

  EXPECT_FALSE(let_pass(loop, clock, hours(1) - nanoseconds(1)));
  EXPECT_TRUE(fired.empty());
  let_pass(loop, clock, nanoseconds(1));
  EXPECT_THAT(fired, testing::ElementsAre(begin + hours(1)));
  EXPECT_EQ(loop.next_timer(), std::nullopt);
}

// What comes last is what is put in first: each sets the next.
TEST(ManualClock, EachMomentOnTheWayIsSeenAsItIs) {
  ManualClock clock;
  Loop loop(clock);
  std::vector<Instant> fired;
  const Instant begin = clock.now();
  Timer last(loop, [&] { fired.push_back(loop.now()); });
  last.set(begin + hours(3));
  Timer each(loop, [&] {
    fired.push_back(loop.now());
    if (fired.size() < 2) each.set_after(hours(1));
  });
  each.set_after(hours(1));
  let_pass(loop, clock, hours(5));
  EXPECT_THAT(fired, testing::ElementsAre(begin + hours(1), begin + hours(2), begin + hours(3)));
  EXPECT_EQ(clock.now(), begin + hours(5));
  EXPECT_TRUE(loop.stalls_since(Instant{}).empty()) << "no timer came late";
}

TEST(ManualClock, KeepsALoopRunningUntilItIsMoved) {
  ManualClock clock;
  Loop loop(clock);
  bool fired = false;
  Timer timer(loop, [&fired] { fired = true; });
  timer.set_after(hours(1));
  const auto post = loop.poster();
  std::thread mover([&] {
    post([&] {
      clock.pass(hours(1));
      loop.clock_moved();
    });
  });
  loop.run();
  mover.join();
  EXPECT_TRUE(fired);
}

TEST(ManualClock, ATimerOfTheMachineDoesNotCareForIt) {
  ManualClock clock;
  Loop loop(clock);
  int of_loop = 0;
  Timer timer(loop, [&of_loop] { ++of_loop; });
  timer.set_after(milliseconds(1));
  Instant fired{};
  Timer real(
      loop, [&] { fired = machine_clock().now(); }, Timer::By::machine);
  const Instant begin = machine_clock().now();
  real.set_after(milliseconds(2));
  EXPECT_EQ(loop.next_timer(), clock.now() + milliseconds(1)) << "the machine's are not among them";
  run_until(loop, [&fired] { return fired != Instant{}; });
  EXPECT_GE(fired, begin + milliseconds(2));
  EXPECT_EQ(of_loop, 0);
}

}  // namespace
}  // namespace porttape
