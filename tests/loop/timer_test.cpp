#include "libport/loop/timer.hpp"

#include <chrono>
#include <memory>

#include <gtest/gtest.h>

namespace porttape {
namespace {

using std::chrono::milliseconds;

TEST(Timer, NeverFiresEarly) {
  Loop loop;
  const Instant when = Loop::now() + milliseconds(3);
  Instant fired{};
  Timer timer(loop, [&fired] { fired = Loop::now(); });
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

TEST(Timer, MayBeDestroyedByItsOwnCallback) {
  Loop loop;
  std::unique_ptr<Timer> timer;
  timer = std::make_unique<Timer>(loop, [&timer] { timer.reset(); });
  timer->set_after(milliseconds(1));
  loop.run();
  EXPECT_EQ(timer, nullptr);
}

}  // namespace
}  // namespace porttape
