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

namespace porttape {
namespace {

using std::chrono::milliseconds;

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
