// The engine's parts on their own: Timeline, LatenessHistogram, WriteStream, find_hint, Matcher.

#include <algorithm>
#include <random>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/budget.hpp"
#include "libport/replay/hint.hpp"
#include "libport/replay/lateness.hpp"
#include "libport/replay/matcher.hpp"
#include "libport/replay/replay_clock.hpp"
#include "libport/replay/timeline.hpp"
#include "libport/replay/write_stream.hpp"
#include "tests/support/memory_tape.hpp"

namespace porttape::test {
namespace {

constexpr Instant at_ns(std::int64_t ns) { return Instant{Nanos{ns}}; }

TEST(TimelineTest, MapsBothWays) {
  Timeline timeline(10);
  timeline.anchor(tape_time_us(1'000'000), at_ns(5'000));
  EXPECT_EQ(timeline.real(tape_time_us(1'000'001)), at_ns(5'100));
  EXPECT_EQ(timeline.tape(at_ns(5'100)), tape_time_us(1'000'001));
  EXPECT_EQ(timeline.real(tape_time_us(999'999)), at_ns(4'900));
}

TEST(TimelineTest, RoundsToLateNotToEarly) {
  Timeline timeline(3);
  EXPECT_EQ(timeline.real(tape_time_us(1)), at_ns(334));
  EXPECT_EQ(timeline.real(tape_time_us(3)), at_ns(1'000));
  Timeline slow(0.1);
  EXPECT_EQ(slow.real(tape_time_us(7)), at_ns(70'000));
}

TEST(TimelineTest, FarTimesAreCutNotWrapped) {
  Timeline timeline(1e-9);
  timeline.anchor(tape_time_us(0), at_ns(std::numeric_limits<std::int64_t>::max() - 5));
  EXPECT_EQ(timeline.real(tape_time_us(4'294'967'295'999'999)), Instant::max());
  EXPECT_GT(timeline.real(tape_time_us(-4'294'967'295'999'999)), Instant::min());
}

TEST(TimelineTest, TheLongestTapeKeepsItsMicroseconds) {
  Timeline timeline(1);
  const std::int64_t last = 4'294'967'295'999'999;
  EXPECT_EQ(timeline.real(tape_time_us(last)), at_ns(last * 1000));
}

TEST(Lateness, QuantilesAreWithinSevenPercentAndTheMaximumIsExact) {
  LatenessHistogram histogram;
  EXPECT_EQ(histogram.quantile(0.5), Nanos{0});
  std::mt19937_64 random(7);
  std::vector<std::int64_t> samples;
  for (int i = 0; i < 10'000; ++i) {
    samples.push_back(static_cast<std::int64_t>(random() >> (random() % 63)) &
                      std::numeric_limits<std::int64_t>::max());
    histogram.add(Nanos{samples.back()});
  }
  std::sort(samples.begin(), samples.end());
  EXPECT_EQ(histogram.max(), Nanos{samples.back()});
  for (const double fraction : {0.01, 0.5, 0.9, 0.99, 1.0}) {
    const auto exact = static_cast<double>(samples[static_cast<std::size_t>(fraction * 10'000) - 1]);
    const auto found = static_cast<double>(histogram.quantile(fraction).count());
    EXPECT_GE(found, exact);
    EXPECT_LE(found, exact * 1.07);
  }
}

TEST(Lateness, SmallValuesAreExactAndNegativeOnesZero) {
  LatenessHistogram histogram;
  for (int i = -3; i < 16; ++i) histogram.add(Nanos{i});
  EXPECT_EQ(histogram.quantile(4.0 / 19), Nanos{0});
  EXPECT_EQ(histogram.quantile(5.0 / 19), Nanos{1});
  EXPECT_EQ(histogram.quantile(1), Nanos{15});
}

TEST(WriteStreamTest, PeeksAcrossBlocksWithoutMoving) {
  const auto tape = MemoryTape().write(1, "ab").write(2, "").read(2, "zz").write(3, "cd").write(4, "e");
  MemorySource source(tape);
  Budget budget;
  WriteStream stream(source, budget);
  stream.rewind();
  ASSERT_EQ(stream.look(), WriteStream::State::bytes);
  stream.consume(1);
  EXPECT_EQ(as_text(stream.peek(3)), "bcd");
  EXPECT_EQ(as_text(stream.peek(1)), "b");
  EXPECT_EQ(as_text(stream.peek(99)), "bcde");
  EXPECT_EQ(stream.position(), 1U);
  EXPECT_EQ(as_text(stream.front()), "b");
  stream.skip_to(4);
  EXPECT_EQ(stream.position(), 4U);
  ASSERT_EQ(stream.look(), WriteStream::State::bytes);
  EXPECT_EQ(as_text(stream.front()), "e");
  EXPECT_EQ(stream.front_at(), tape_time_us(4));
  stream.skip_to(100);
  EXPECT_EQ(stream.look(), WriteStream::State::end);
  EXPECT_EQ(stream.front_at(), tape_time_us(4));
  EXPECT_EQ(stream.position(), 5U);
}

TEST(Hint, FindsTheNearestOnEitherSide) {
  const auto tape =
      MemoryTape().write(1, "get;").write(2, "get;").write(3, "set;").write(4, "ge").write(5, "t;get;");
  MemorySource source(tape, MemorySource::Select::writes_only);
  EXPECT_EQ(find_hint(source, 8, as_bytes("get;")),
            "already consumed at offset 4 (tape 0.000002 s); comes later at offset 12 (tape 0.000004 s)");
  EXPECT_EQ(find_hint(source, 8, as_bytes("nope")), "");
  EXPECT_EQ(find_hint(source, 8, {}), "");
}

TEST(Hint, FindsOverlappingRepeatsInAnyPieces) {
  const std::string text = "aabaabaaac";
  for (std::size_t piece = 1; piece < 5; ++piece) {
    const auto tape = MemoryTape().write(1, "x").write(2, text);
    MemorySource source(tape, MemorySource::Select::writes_only, piece);
    EXPECT_EQ(find_hint(source, 0, as_bytes("aabaaa")), "comes later at offset 4 (tape 0.000002 s)");
  }
}

TEST(Hint, FindsTheLastOfOverlappingOnes) {
  const auto tape = MemoryTape().write(1, "aaab");
  MemorySource source(tape, MemorySource::Select::writes_only);
  EXPECT_EQ(find_hint(source, 3, as_bytes("aa")), "already consumed at offset 1 (tape 0.000001 s)");
}

TEST(Hint, DamageMeansNoHint) {
  const auto tape = MemoryTape().write(1, "abc").write(2, "def");
  MemorySource source(tape, MemorySource::Select::writes_only);
  source.fail_at(1);
  EXPECT_EQ(find_hint(source, 0, as_bytes("def")), "");
}

TEST(MatcherTest, TellsWhenEachPieceOfABlockWasComplete) {
  const MemoryTape tape = MemoryTape().write(1, "abcdef");
  MemorySource source(tape, MemorySource::Select::writes_only, 2);
  Budget budget;
  const ReplayClock clock(1);
  Matcher matcher(source, budget, clock, Micros{500});
  matcher.rewind();
  (void)matcher.write(at_ns(1), as_bytes("abc"));
  (void)matcher.write(at_ns(2), as_bytes("def"));
  EXPECT_EQ(matcher.position(), 6U);
  EXPECT_EQ(matcher.completion(2)->real, at_ns(1));
  EXPECT_EQ(matcher.completion(4)->real, at_ns(2));
  EXPECT_EQ(matcher.completion(6)->real, at_ns(2));
}

TEST(MatcherTest, MemoryIsBoundedForADriverFarAhead) {
  MemoryTape tape;
  for (int i = 0; i < 20'000; ++i) tape.write(i, "x");
  MemorySource source(tape, MemorySource::Select::writes_only);
  Budget budget;
  const ReplayClock clock(1);
  Matcher matcher(source, budget, clock, Micros{500});
  matcher.rewind();
  for (int i = 0; i < 20'000; ++i) {
    budget.refill();
    (void)matcher.write(at_ns(i), as_bytes("x"));
  }
  EXPECT_EQ(matcher.position(), 20'000U);
  EXPECT_EQ(matcher.completion(1)->real, at_ns(0));
  EXPECT_EQ(matcher.completion(4'095)->real, at_ns(4'094));
  EXPECT_EQ(matcher.completion(10'000)->real, at_ns(19'999));  // merged: later, never earlier
  EXPECT_EQ(matcher.completion(20'001), std::nullopt);
}

}  // namespace
}  // namespace porttape::test
