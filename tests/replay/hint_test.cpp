// Where else on the tape the driver's bytes stand.

#include "libport/replay/hint.hpp"

#include <string>

#include <gtest/gtest.h>

#include "libport/replay/lateness.hpp"
#include "libport/replay/line_view.hpp"
#include "libport/replay/tape_count.hpp"
#include "tests/support/memory_tape.hpp"

namespace porttape::test {
namespace {

std::string hint(const MemoryTape& tape, std::uint64_t offset, std::string_view got) {
  MemorySource source(tape, MemorySource::Select::writes_only);
  return find_hint(source, offset, as_bytes(got)).value();
}

TEST(HintPlace, WhatStandsAtTheOffsetItselfIsNoneElsewhere) {
  const MemoryTape tape = MemoryTape().write(1, "abc").write(2, "abc").write(3, "abc");
  EXPECT_EQ(hint(tape, 3, "abc"),
            "already consumed at offset 0 (tape 0.000001 s); comes later at offset 6 (tape 0.000003 s)");
  EXPECT_EQ(hint(tape, 4, "cab"), "comes later at offset 5 (tape 0.000002 s)")
      << "the one before ends behind the offset";
}

TEST(HintPlace, TheFirstSixteenBytesAreLookedFor) {
  const MemoryTape tape = MemoryTape().write(0, "------").write(1, "0123456789abcdef.");
  EXPECT_EQ(hint(tape, 0, "0123456789abcdefg"), "comes later at offset 6 (tape 0.000001 s)");
  EXPECT_EQ(hint(tape, 0, "0123456789abcdeX"), "");
}

TEST(HintPlace, SixteenMegabytesOnEitherSideAreLookedThrough) {
  const auto with_between = [](int megabytes, std::string_view first, std::string_view last) {
    MemoryTape tape;
    tape.write(1, first);
    for (int i = 0; i < megabytes; ++i) tape.write(2, std::string(std::size_t{1} << 20, 'z'));
    return tape.write(3, last);
  };
  constexpr std::uint64_t kMega = std::uint64_t{1} << 20;
  EXPECT_EQ(hint(with_between(15, "needle", ""), 6 + 15 * kMega, "needle"),
            "already consumed at offset 0 (tape 0.000001 s)");
  EXPECT_EQ(hint(with_between(17, "needle", ""), 6 + 17 * kMega, "needle"), "");
  EXPECT_EQ(hint(with_between(15, "", "needle"), 0, "needle"),
            "comes later at offset 15728640 (tape 0.000003 s)");
  EXPECT_EQ(hint(with_between(17, "", "needle"), 0, "needle"), "");
}

TEST(HintPlace, IsGivenUpWhenAsked) {
  MemoryTape tape;
  for (unsigned i = 0; i < kRecordsBetweenLooks; ++i) tape.write(0, "x");
  MemorySource source(tape);
  EXPECT_EQ(find_hint(source, 0, as_bytes("y"), [] { return true; }), std::nullopt);
  EXPECT_EQ(source.calls(), kRecordsBetweenLooks - 1);
  EXPECT_EQ(find_hint(source, 0, as_bytes("y"), [] { return false; }), "");
}

TEST(TapeCount, CountsBothDirectionsAndWhatIsBeforeTheStart) {
  const MemoryTape tape =
      MemoryTape().read(0, "a").write(9, "bb").read(10, "ccc").write(10, "dddd").event(11, event::Mark{});
  MemorySource source(tape);
  EXPECT_EQ(count_tape(source, {}, tape_time_us(10)),
            (TapeTotals{.reads = 4, .writes = 6, .reads_before = 1, .writes_before = 2}));
}

TEST(TapeCount, IsGivenUpWhenAsked) {
  MemoryTape tape;
  for (unsigned i = 0; i < kRecordsBetweenLooks; ++i) tape.write(0, "x");
  MemorySource source(tape);
  EXPECT_EQ(count_tape(source, [] { return true; }, {}), std::nullopt);
  EXPECT_EQ(source.calls(), kRecordsBetweenLooks - 1);
}

TEST(LineViewText, EachSignalHasItsName) {
  EXPECT_EQ(to_text(LineView::of(LineSignal{LineSignal::Name::dtr, true})), "dtr on");
  EXPECT_EQ(to_text(LineView::of(LineSignal{LineSignal::Name::rts, false})), "rts off");
  EXPECT_EQ(to_text(LineView::of(LineSignal{LineSignal::Name::brk, true})), "break on");
  LineView both = LineView::of(SeenSettings{.baud = 300U});
  both.dtr = false;
  EXPECT_EQ(to_text(both), "300 baud, dtr off");
}

// The smallest of a bucket and the one before it are told apart.
TEST(LatenessLimits, FourBitsAreKeptOfEachValue) {
  const auto told = [](std::int64_t nanos) {
    LatenessHistogram histogram;
    histogram.add(Nanos{nanos});
    histogram.add(Nanos{1'000'000});
    return histogram.quantile(0.5).count();
  };
  EXPECT_EQ(told(15), 15);
  EXPECT_EQ(told(16), 16);
  EXPECT_EQ(told(31), 31);
  EXPECT_EQ(told(32), 33);
  EXPECT_EQ(told(33), 33);
  EXPECT_EQ(told(63), 63);
  EXPECT_EQ(told(64), 67);
}

TEST(LatenessLimits, AQuantileIsOfAtLeastOneSampleAndAtMostAll) {
  LatenessHistogram histogram;
  EXPECT_EQ(histogram.quantile(0.5), Nanos{0});
  for (const int nanos : {1, 2, 3}) histogram.add(Nanos{nanos});
  EXPECT_EQ(histogram.quantile(0), Nanos{1});
  EXPECT_EQ(histogram.quantile(0.33), Nanos{1});
  EXPECT_EQ(histogram.quantile(0.34), Nanos{2});
  EXPECT_EQ(histogram.quantile(1), Nanos{3});
  EXPECT_EQ(histogram.quantile(2), Nanos{3});
  EXPECT_EQ(histogram.count(), 3U);
}

}  // namespace
}  // namespace porttape::test
