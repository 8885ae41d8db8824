#include "libport/loop/loop.hpp"

#include <array>
#include <chrono>
#include <fcntl.h>
#include <fstream>
#include <functional>
#include <optional>
#include <sched.h>
#include <string>
#include <thread>
#include <unistd.h>
#include <vector>

#include <gtest/gtest.h>

#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/patience.hpp"
#include "libport/loop/stall_watch.hpp"
#include "libport/loop/timer.hpp"
#include "tests/support/manual_clock.hpp"
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

// A clock that each look moves on by a microsecond.
class LookedAt final : public Clock {
 public:
  [[nodiscard]] Instant now() const override {
    if (left > 0 && --left == 0) on_last();
    return at(1) + std::chrono::microseconds(++looks);
  }
  [[nodiscard]] WallTime wall() const override { return {}; }
  [[nodiscard]] std::optional<Instant> machine_time(Instant) const override { return std::nullopt; }

  mutable int looks = 0;
  mutable int left = 0;
  std::function<void()> on_last;  // which happens within the last of so many
};

TEST(LoopPolls, InAConversationTheNextEventIsLookedForWithoutASleep) {
  LookedAt looked;
  Loop loop(machine_clock(), looked);
  std::array<int, 2> ends{};
  ASSERT_EQ(::pipe2(ends.data(), O_NONBLOCK | O_CLOEXEC), 0);
  const UniqueFd in(ends[0]);
  const UniqueFd out(ends[1]);
  const auto say = [&out] { EXPECT_EQ(::write(out.get(), "x", 1), 1); };
  looked.on_last = say;
  int heard = 0;
  FdWatch watch(loop, in.get(), [&] {
    char byte = 0;
    ASSERT_EQ(::read(in.get(), &byte, 1), 1);
    ++heard;
    if (heard < 2 * Patience::kShortWaitsInARow) return say();
    if (heard > 2 * Patience::kShortWaitsInARow) return loop.stop();
    looked.left = 10;  // while it sleeps nobody looks at the clock
  });
  watch.watch_readable(true);
  bool slept = false;
  Timer wake(loop, [&] {
    slept = true;
    loop.stop();
  });
  wake.set_after(std::chrono::seconds(10));
  say();
  loop.run();
  EXPECT_FALSE(slept);
  EXPECT_EQ(heard, 2 * Patience::kShortWaitsInARow + 1);
}

// A regular file has no events: the kernel refuses to watch it.
// A clock that goes on by each look at it.
class SteppingClock final : public Clock {
 public:
  [[nodiscard]] Instant now() const override {
    ++looks;
    return now_ += step;
  }
  [[nodiscard]] WallTime wall() const override { return {}; }
  [[nodiscard]] std::optional<Instant> machine_time(Instant when) const override { return when; }

  mutable int looks = 0;
  Nanos step = std::chrono::microseconds(1);

 private:
  mutable Instant now_{std::chrono::hours(1)};
};

// Until the kernel shows that this thread sleeps.
void until_asleep(pid_t thread) {
  const std::string file = "/proc/self/task/" + std::to_string(thread) + "/stat";
  for (std::string text; text.find(") S ") == std::string::npos; ::sched_yield())
    std::getline(std::ifstream(file) >> std::ws, text);
}

// How often the clock is looked at in a wait, behind a poll that lost the processor or did not.
int looks_in_a_wait(bool processor_lost) {
  const ManualClock clock;
  SteppingClock machine;
  Loop loop(clock, machine);
  std::array<int, 2> ends{};
  EXPECT_EQ(::pipe2(ends.data(), O_NONBLOCK | O_CLOEXEC), 0);
  const UniqueFd read_end(ends[0]);
  const UniqueFd write_end(ends[1]);
  int wakes = 0;
  int tasks = 0;
  int before = 0;
  std::thread waker;
  const auto wake_when_asleep = [&, loops = ::gettid()] {
    if (waker.joinable()) waker.join();
    waker = std::thread([&, loops] {
      until_asleep(loops);
      (void)!::write(write_end.get(), "x", 1);
    });
  };
  std::function<void()> task = [&] {
    if (++tasks < 2 * Patience::kShortWaitsInARow) return loop.post(task);
    tasks = 0;
    if (wakes == 1 && processor_lost) machine.step = Patience::kPreempted;
    wake_when_asleep();
    before = machine.looks;
  };
  FdWatch watch(loop, read_end.get(), [&] {
    char byte = 0;
    (void)!::read(read_end.get(), &byte, 1);
    if (++wakes == 3) return loop.stop();
    machine.step = std::chrono::microseconds(1);
    loop.post(task);
  });
  watch.watch_readable(true);
  (void)!::write(write_end.get(), "x", 1);
  loop.run();
  waker.join();
  return machine.looks - before;
}

TEST(LoopPolls, AfterALostProcessorItSleepsAtOnceForAWhile) {
  EXPECT_GE(looks_in_a_wait(false), 25);
  EXPECT_LE(looks_in_a_wait(true), 5);
}

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
