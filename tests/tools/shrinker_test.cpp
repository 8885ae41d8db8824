// Delta debugging against drivers that are functions.

#include "tools/shrinker.hpp"

#include <algorithm>
#include <functional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace porttape {
namespace {

constexpr std::uint64_t kAnswer = 10;  // bytes of each
constexpr std::uint64_t kRequest = 4;

Fault drop_at(std::uint64_t position) {
  return {.kind = Fault::Kind::drop, .when = Fault::When::byte, .position = position, .dir = LineDir::r};
}

// Asks for parts, gets them with the faults in their bytes, asks again what came damaged (so often), and
// fails where the test says so.
struct Driver {
  std::size_t wants = 0;         // exchanges, each by its number
  bool data_driven = false;      // it asks what the tape has
  std::size_t fails_behind = 1;  // faults
  std::size_t needs = 0;         // only where it has had this exchange

  // Fills in how it went; true: it failed by a fault, and asked nothing that is not there.
  bool run(ShrinkCase& one) const {
    FaultRunEnd end;
    std::uint64_t read = 0;
    std::uint64_t written = 0;
    std::size_t faults = 0;
    bool had = false;
    for (std::size_t n = 0; n < (data_driven ? one.parts.size() : wants); ++n) {
      const auto part =
          data_driven ? one.parts.begin() + static_cast<std::ptrdiff_t>(n) : std::ranges::find(one.parts, n);
      if (part == one.parts.end()) return false;
      had = had || *part == needs;
      for (bool again = true; again;) {
        const auto index = static_cast<std::size_t>(part - one.parts.begin());
        end.turns.push_back({index, read, written});
        end.reach = std::max(end.reach, index + 1);
        again = std::ranges::any_of(one.faults, [&](const Fault& fault) {
          return fault.position >= read && fault.position < read + kAnswer;
        });
        read += kAnswer;
        written += kRequest;
        if (again && had && ++faults == fails_behind) {
          one.end = end;
          return true;
        }
      }
    }
    return false;
  }
};

struct Shrunk {
  ShrinkCase best;
  int runs = 0;
};

Shrunk shrink(const Driver& driver, std::size_t parts, std::vector<Fault> faults) {
  ShrinkCase failing{{}, std::move(faults)};
  for (std::size_t part = 0; part < parts; ++part) failing.parts.push_back(part);
  EXPECT_TRUE(driver.run(failing));
  Shrunk shrunk;
  Shrinker shrinker(
      failing,
      [&](std::vector<ShrinkCase>& cases) -> std::optional<std::size_t> {
        for (std::size_t n = 0; n < cases.size(); ++n) {
          ++shrunk.runs;
          if (driver.run(cases[n])) return n;
        }
        return std::nullopt;
      },
      [] { return false; });
  shrunk.best = shrinker.run();
  EXPECT_TRUE(driver.run(shrunk.best));
  return shrunk;
}

TEST(Shrinker, MovesAFaultToTheFirstExchangeOfAFixedSequence) {
  const Shrunk shrunk = shrink({.wants = 500}, 500, {drop_at(2503), drop_at(3000), drop_at(4444)});
  EXPECT_EQ(shrunk.best.parts, (std::vector<std::size_t>{0}));
  EXPECT_EQ(shrunk.best.faults, (std::vector<Fault>{drop_at(3)})) << "the same place in its answer";
  EXPECT_LE(shrunk.runs, 20);
}

TEST(Shrinker, KeepsSeveralFaultsThatItTakes) {
  const Shrunk shrunk = shrink({.wants = 500, .fails_behind = 2}, 500,
                               {drop_at(77), drop_at(2503), drop_at(4444), drop_at(4457)});
  EXPECT_EQ(shrunk.best.faults.size(), 2U);
  EXPECT_LE(shrunk.best.parts.size(), 250U);
}

TEST(Shrinker, KeepsTheExchangeThatTheFailureNeeds) {
  const Shrunk shrunk = shrink({.data_driven = true, .needs = 123}, 500, {drop_at(4003), drop_at(10)});
  EXPECT_LE(shrunk.best.parts.size(), 2U);
  EXPECT_EQ(shrunk.best.parts.front(), 123U);
  EXPECT_EQ(shrunk.best.faults.size(), 1U);
  EXPECT_LE(shrunk.runs, 100);
}

TEST(Shrinker, CutsWhatComesBehindTheFailure) {
  const Shrunk shrunk = shrink({.wants = 500, .needs = 40}, 500, {drop_at(4003)});
  EXPECT_GE(shrunk.best.parts.size(), 41U) << "it asks for all of them up to there";
  EXPECT_LE(shrunk.best.parts.size(), 50U);
}

TEST(Shrinker, ShortensBursts) {
  Fault burst = drop_at(53);
  burst.burst = 6;
  const Shrunk shrunk = shrink({.wants = 10}, 10, {burst});
  EXPECT_EQ(shrunk.best.faults, (std::vector<Fault>{drop_at(3)}));
}

TEST(Shrinker, StopsWhenTold) {
  ShrinkCase failing{{0, 1, 2}, {drop_at(3)}};
  Driver{.wants = 3}.run(failing);
  Shrinker shrinker(
      failing,
      [](std::vector<ShrinkCase>&) -> std::optional<std::size_t> {
        ADD_FAILURE() << "nothing is tried";
        return std::nullopt;
      },
      [] { return true; });
  EXPECT_EQ(shrinker.run().parts.size(), 3U);
}

}  // namespace
}  // namespace porttape
