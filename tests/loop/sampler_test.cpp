#include "libport/loop/sampler.hpp"

#include <array>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

#include <gtest/gtest.h>

#include "libport/loop/fence.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/timer.hpp"
#include "tests/support/manual_clock.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

class SamplerTest : public testing::Test {
 protected:
  void run_until(const std::function<bool()>& done) {
    while (!done()) loop.run_one();
  }
  // Looked at in this order.
  const void* first() const { return &owners[0]; }
  const void* second() const { return &owners[1]; }

  Loop loop;
  Sampler sampler{loop};
  std::array<int, 2> looks{};
  std::array<char, 2> owners{};
};

TEST_F(SamplerTest, LooksAgainAndAgainAtAllMembers) {
  const Instant begin = loop.now();
  sampler.add(first(), [this] { ++looks[0]; });
  sampler.add(second(), [this] { ++looks[1]; });
  run_until([this] { return looks[0] >= 3 && looks[1] >= 3; });
  EXPECT_GE(loop.now() - begin, 2 * Sampler::kQuick);
}

TEST_F(SamplerTest, LooksAtNobodyThatIsRemoved) {
  sampler.add(second(), [this] { ++looks[1]; });
  sampler.add(first(), [this] {
    ++looks[0];
    sampler.remove(first());
    sampler.remove(second());
  });
  while (loop.run_one()) {
  }
  EXPECT_EQ(looks[0], 1);
  EXPECT_EQ(looks[1], 0) << "removed within the same round";
}

TEST_F(SamplerTest, AMemberThatIsAddedAgainAndAgainIsLookedAtAllTheSame) {
  const auto look = [this] { ++looks[0]; };
  int added = 0;
  sampler.add(first(), look);
  Timer again(loop, [&] {
    sampler.add(first(), look);
    ++added;
    again.set_after(milliseconds(2));
  });
  again.set_after(milliseconds(2));
  run_until([&] { return looks[0] > 0 || added == 200; });
  EXPECT_GT(looks[0], 0);
}

// By a clock that a test moves: how often a line is looked at.
class SamplersRhythm : public testing::Test {
 protected:
  void add(int n) {
    sampler.add(&owners.at(static_cast<std::size_t>(n)),
                [this, n] { ++looks.at(static_cast<std::size_t>(n)); });
  }
  // Looks at one of them in this time.
  int looks_in(Nanos time, std::size_t n = 0) {
    const int before = looks.at(n);
    (void)let_pass(loop, clock, time);
    return looks.at(n) - before;
  }

  ManualClock clock;
  Loop loop{clock};
  Sampler sampler{loop};
  std::array<int, 2> looks{};
  std::array<char, 2> owners{};
};

TEST_F(SamplersRhythm, ANewLineIsLookedAtEveryFiveMillisecondsForASecond) {
  add(0);
  EXPECT_EQ(looks_in(milliseconds(4)), 0);
  EXPECT_EQ(looks_in(milliseconds(1)), 1);
  EXPECT_EQ(looks_in(milliseconds(990)), 198);
  (void)looks_in(milliseconds(5));
  EXPECT_LE(looks_in(seconds(6)), 11) << "rarely, from then on";
}

TEST_F(SamplersRhythm, AnIdleLineIsLookedAtRarely) {
  add(0);
  (void)looks_in(seconds(2));
  EXPECT_EQ(looks_in(milliseconds(6000)), 10);
}

TEST_F(SamplersRhythm, ALineOnWhichSomethingHappensIsLookedAtTenTimesASecondForTwo) {
  add(0);
  (void)looks_in(seconds(2));
  sampler.touch(&owners[0]);
  const int first = looks_in(milliseconds(1900));
  EXPECT_GE(first, 18);
  EXPECT_LE(first, 20);
  (void)looks_in(milliseconds(200));
  EXPECT_EQ(looks_in(milliseconds(6000)), 10);
}

TEST_F(SamplersRhythm, OneLinesBusinessIsNotAnothers) {
  add(0);
  add(1);
  (void)looks_in(seconds(2));
  sampler.touch(&owners[1]);
  EXPECT_LE(looks_in(milliseconds(1800)), 3);
  add(1);
  EXPECT_LE(looks_in(milliseconds(1200)), 2);
}

TEST_F(SamplersRhythm, AnIdleLineIsLookedAtHoweverBusyAnotherIs) {
  add(0);
  add(1);
  (void)looks_in(seconds(2));
  const int before = looks[0];
  for (int n = 0; n < 12; ++n) {
    sampler.touch(&owners[1]);
    (void)looks_in(milliseconds(500));
  }
  EXPECT_EQ(looks[0] - before, 10) << "as if it were alone";
}

TEST_F(SamplersRhythm, ALineOnWhichSomethingHappensIsNotLookedAtAsOftenAsANewOne) {
  add(0);
  (void)looks_in(seconds(2));
  sampler.touch(&owners[0]);
  add(1);
  const int looks_at_new = looks[1];
  const int looks_at_old = looks_in(milliseconds(990));
  EXPECT_GE(looks_at_old, 9);
  EXPECT_LE(looks_at_old, 12);
  EXPECT_EQ(looks[1] - looks_at_new, 198);
}

TEST_F(SamplersRhythm, ALineThatIsAddedAgainIsYoungAgain) {
  add(0);
  (void)looks_in(seconds(2));
  add(0);
  EXPECT_EQ(looks_in(milliseconds(500)), 100);
}

TEST_F(SamplersRhythm, NobodyIsWokenForNoLine) {
  add(0);
  add(1);
  sampler.remove(&owners[0]);
  EXPECT_TRUE(loop.next_timer());
  sampler.remove(&owners[1]);
  sampler.remove(&owners[1]);
  sampler.touch(&owners[1]);
  EXPECT_FALSE(loop.next_timer());
}

TEST_F(SamplerTest, AMemberThatIsAddedAgainHasTheNewLookAlone) {
  sampler.add(first(), [this] { ++looks[0]; });
  sampler.add(first(), [this] { ++looks[1]; });
  run_until([this] { return looks[1] == 2; });
  EXPECT_EQ(looks[0], 0);
}

TEST_F(SamplerTest, WhatOneLookThrowsIsItsOwnFencesAlone) {
  std::string caught;
  const auto fence = std::make_shared<Fence>();
  fence->on_exception = [&caught](const std::string& what) { caught = what; };
  loop.within(fence, [this] { sampler.add(first(), [] { throw std::runtime_error("trouble"); }); });
  sampler.add(second(), [this] { ++looks[1]; });
  run_until([this] { return looks[1] == 1; });
  EXPECT_EQ(caught, "trouble");
}

TEST_F(SamplerTest, ALookThatTakesLongIsAStallHoweverManyFollow) {
  const Instant begin = loop.now();
  sampler.add(first(), [this] {
    ++looks[0];
    std::this_thread::sleep_for(milliseconds(90));
  });
  sampler.add(second(), [this] { ++looks[1]; });
  run_until([this] { return looks[1] == 1; });
  const std::vector<Stall> stalls = loop.stalls_since(begin);
  ASSERT_FALSE(stalls.empty());
  EXPECT_GE(stalls.back().length, milliseconds(90));
}

}  // namespace
}  // namespace porttape
