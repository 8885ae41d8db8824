#include "libport/loop/loop.hpp"

#include <chrono>
#include <fcntl.h>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/stall_watch.hpp"
#include "libport/loop/timer.hpp"
#include "tests/support/time_bound.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;

Instant at(int ms) { return Instant{} + milliseconds(ms); }

TEST(StallWatch, KeepsWhatTookLong) {
  StallWatch watch;
  watch.late(at(0), at(50));
  EXPECT_TRUE(watch.since(Instant{}).empty());
  watch.late(at(100), at(151));
  watch.late(at(300), at(400));
  EXPECT_EQ(watch.since(Instant{}),
            (std::vector<Stall>{{at(100), milliseconds(51)}, {at(300), milliseconds(100)}}));
  EXPECT_EQ(watch.since(at(151)), (std::vector<Stall>{{at(300), milliseconds(100)}}));
}

TEST(StallWatch, WhatOverlapsIsOneAndToldOnce) {
  StallWatch watch;
  int told = 0;
  watch.on_stall([&told](const Stall&) { ++told; });
  watch.late(at(100), at(200));
  watch.late(at(120), at(210));
  watch.late(at(90), at(205));
  EXPECT_EQ(watch.since(Instant{}), (std::vector<Stall>{{at(90), milliseconds(120)}}));
  EXPECT_EQ(told, 1);
}

TEST(StallWatch, IsBounded) {
  StallWatch watch;
  for (int i = 0; i < 1000; ++i) watch.late(at(i * 100), at(i * 100 + 60));
  EXPECT_EQ(watch.since(Instant{}).size(), StallWatch::kKept);
  EXPECT_EQ(watch.since(Instant{}).back().begin, at(99'900));
}

TEST(LoopStalls, AHandlerThatTakesLongIsOne) {
  Loop loop;
  int told = 0;
  loop.on_stall([&told](const Stall&) { ++told; });
  const Instant begin = loop.now();
  Timer late(loop, [] {});
  late.set(begin + milliseconds(10));  // what waits behind it is part of the same stall
  loop.post([] { std::this_thread::sleep_for(milliseconds(120)); });
  loop.run();
  const std::vector<Stall> stalls = loop.stalls_since(begin);
  ASSERT_FALSE(stalls.empty());
  EXPECT_GE(stalls.front().length, milliseconds(120));
  EXPECT_EQ(static_cast<std::size_t>(told), stalls.size());
  EXPECT_WITHIN(told, 1);
}

TEST(LoopStalls, WhatWasLateBeforeTheLoopRanIsNone) {
  Loop loop;
  Timer timer(loop, [] {});
  timer.set(loop.now() - std::chrono::seconds(1));
  loop.run();
  EXPECT_IN_TIME(loop.stalls_since(Instant{}).empty());
}

TEST(LoopStalls, ATimerThatIsSetForThePastIsNone) {
  Loop loop;
  Timer second(loop, [] {});
  Timer first(loop, [&loop, &second] { second.set(loop.now() - std::chrono::seconds(1)); });
  first.set_after(milliseconds(1));
  loop.run();
  EXPECT_IN_TIME(loop.stalls_since(Instant{}).empty());
}

TEST(LoopStalls, AWaitForTheFirstEventIsNone) {
  Loop loop;
  bool done = false;
  ASSERT_TRUE(loop.run_elsewhere(
      Workers::Strand(), [] { std::this_thread::sleep_for(milliseconds(80)); }, [&done] { done = true; }));
  loop.run();
  EXPECT_TRUE(done);
  EXPECT_IN_TIME(loop.stalls_since(Instant{}).empty());
}

// A regular file has no events: the kernel refuses to watch it.
TEST(FdWatch, LooksItselfWhereTheKernelDoesNotWatch) {
  Loop loop;
  const UniqueFd file(::open("/proc/self/exe", O_RDONLY));
  int readable = 0;
  FdWatch watch(loop, file.get(), [&] {
    if (++readable == 3) watch.stop();
  });
  watch.watch_readable(true);
  loop.run();
  EXPECT_EQ(readable, 3);
}

}  // namespace
}  // namespace porttape
