#include "libport/loop/fence.hpp"

#include <array>
#include <stdexcept>
#include <string>
#include <unistd.h>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/timer.hpp"

namespace porttape {
namespace {

class FenceTest : public testing::Test {
 protected:
  FenceTest() {
    fence->on_exception = [this](const std::string& what) { caught += what + " "; };
  }
  void run_ready() {
    while (loop.poll_one()) {
    }
    loop.restart();
  }
  void run_until_caught(const std::string& all) {
    while (caught != all) {
      loop.restart();
      loop.run_one();
    }
  }
  static std::function<void()> thrower(const char* what) {
    return [what] { throw std::runtime_error(what); };
  }

  Loop loop;
  std::shared_ptr<Fence> fence = std::make_shared<Fence>();
  std::string caught;
};

TEST_F(FenceTest, HoldsWhatIsThrownAtOnce) {
  loop.within(fence, thrower("start"));
  EXPECT_EQ(caught, "start ");
  EXPECT_EQ(loop.fence(), nullptr);
}

TEST_F(FenceTest, HoldsWhatTasksTimersAndWatchesThrowLater) {
  std::array<int, 2> ends{};
  ASSERT_EQ(::pipe(ends.data()), 0);
  const UniqueFd out(ends[0]);
  const UniqueFd in(ends[1]);
  std::optional<Timer> timer;
  std::optional<FdWatch> watch;
  loop.within(fence, [&] {
    loop.post(thrower("task"));
    timer.emplace(loop, thrower("timer"));
    watch.emplace(loop, out.get(), [&] {
      watch->watch_readable(false);
      throw std::runtime_error("watch");
    });
  });
  run_ready();
  EXPECT_EQ(caught, "task ");
  timer->set(loop.now());
  run_until_caught("task timer ");
  ASSERT_EQ(::write(in.get(), "x", 1), 1);
  watch->watch_readable(true);
  run_until_caught("task timer watch ");
}

TEST_F(FenceTest, HoldsWhatComesOfWorkElsewhere) {
  loop.within(fence, [&] {
    ASSERT_TRUE(loop.run_elsewhere(
        {}, [] {}, thrower("done")));
  });
  run_until_caught("done ");
}

TEST_F(FenceTest, HoldsWhatWorkElsewhereThrows) {
  loop.within(fence, [&] { ASSERT_TRUE(loop.run_elsewhere({}, thrower("job"), thrower("done"))); });
  run_until_caught("job ");
}

TEST_F(FenceTest, WhatIsMadeBehindItStaysBehindIt) {
  loop.within(fence, [&] { loop.post([&] { loop.post(thrower("grandchild")); }); });
  run_ready();
  EXPECT_EQ(caught, "grandchild ");
}

TEST_F(FenceTest, TheOthersGoOn) {
  bool ran = false;
  loop.within(fence, [&] { loop.post(thrower("one")); });
  loop.post([&] { ran = true; });
  run_ready();
  EXPECT_TRUE(ran);
}

TEST_F(FenceTest, WithoutOneExceptionsLeaveTheLoop) {
  loop.post(thrower("free"));
  EXPECT_THROW(loop.poll_one(), std::runtime_error);
}

}  // namespace
}  // namespace porttape
