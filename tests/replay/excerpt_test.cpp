// What of a tape is shown around a fault.

#include "libport/replay/excerpt.hpp"

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/memory_tape.hpp"

namespace porttape::test {
namespace {

TapeExcerpt excerpt(const MemoryTape& tape, std::uint64_t offset, const FrameEnds& ends = {}) {
  MemorySource source(tape);
  return read_excerpt(source, offset, kFrameGap, {}, ends).value();
}

// "1 2 | 3": the texts of the frames, those of one exchange with a blank between them.
std::string frames(const TapeExcerpt& excerpt) {
  std::string out;
  std::uint64_t exchange = 0;
  for (const TapeExcerpt::Step& step : excerpt.steps) {
    if (!out.empty()) out += step.frame.exchange == exchange ? " " : " | ";
    exchange = step.frame.exchange;
    out += as_text(step.frame.bytes);
  }
  return out;
}

std::string frames(const MemoryTape& tape) { return frames(excerpt(tape, 0)); }

// So many exchanges, each a request of one byte and an answer.
MemoryTape exchanges(int count) {
  MemoryTape tape;
  for (int i = 0; i < count; ++i) tape.write(i * 1000, "x").read(i * 1000 + 500, "y");
  return tape;
}

TEST(ExcerptFrames, LinesAreFramesWhereTheFirstRequestEndsALine) {
  EXPECT_EQ(frames(MemoryTape().write(0, "a\r\nb\n").read(1, "-").write(2, "c\n")), "a\r\n b\n | c\n");
  EXPECT_EQ(frames(MemoryTape().write(0, "a").read(1, "-").write(2, "b\nc\n")), "a | b\nc\n");
  EXPECT_EQ(frames(MemoryTape().write(0, "a\n").read(1, "-").write(2, "b\nc")), "a\n | b\nc");
  EXPECT_TRUE(excerpt(MemoryTape().write(0, "a\n"), 0).lines);
  EXPECT_FALSE(excerpt(MemoryTape().write(0, "a"), 0).lines);
}

TEST(ExcerptFrames, BytesOfOneMomentAreOneFrameAndTheGapIsHalfAMillisecond) {
  EXPECT_EQ(frames(MemoryTape().write(0, "a").write(499, "b")), "ab");
  EXPECT_EQ(frames(MemoryTape().write(0, "a").write(500, "b")), "a b");
}

TEST(ExcerptFrames, SomebodyElseMaySayWhereTheyEndInRisingOrder) {
  const auto ends = [](ByteView, const std::vector<std::size_t>&) {
    return std::vector<std::size_t>{0, 1, 1, 3, 5};
  };
  EXPECT_EQ(frames(excerpt(MemoryTape().write(0, "abc"), 0, ends)), "a bc") << "none is empty or too long";
}

TEST(ExcerptFrames, EachKnowsItsPartAndItsTimes) {
  const MemoryTape tape =
      MemoryTape().write(1000, "ab").write(1100, "c").write(2000, "d").read(3000, "-").write(4000, "e");
  const TapeExcerpt found = excerpt(tape, 0);
  ASSERT_EQ(found.steps.size(), 3U);
  const TapeFrame& first = found.steps[0].frame;
  EXPECT_EQ(first.part, 1U);
  EXPECT_EQ(first.parts, 2U);
  EXPECT_EQ(first.offset, 0U);
  EXPECT_EQ(first.length, 3U);
  EXPECT_EQ(first.begun, tape_time_us(1000));
  EXPECT_EQ(first.at, tape_time_us(1100));
  const TapeFrame& second = found.steps[1].frame;
  EXPECT_EQ(second.part, 2U);
  EXPECT_EQ(second.parts, 2U);
  EXPECT_EQ(second.offset, 3U);
  EXPECT_EQ(second.begun, tape_time_us(2000));
  const TapeFrame& last = found.steps[2].frame;
  EXPECT_EQ(last.exchange, 2U);
  EXPECT_EQ(last.part, 1U);
  EXPECT_EQ(last.parts, 1U);
}

TEST(ExcerptAnswer, IsAllThatIsReadUpToTheNextWrite) {
  const MemoryTape tape =
      MemoryTape().read(0, "hello").write(1000, "a").read(2000, "x").read(3000, "").read(4000, "yz");
  const TapeExcerpt found = excerpt(tape, 0);
  ASSERT_EQ(found.steps.size(), 1U);
  const TapeAnswer& answer = found.steps[0].answer.value();
  EXPECT_EQ(as_text(answer.bytes), "xyz");
  EXPECT_EQ(answer.length, 3U);
  EXPECT_EQ(answer.offset, 5U) << "what comes unasked is before it";
  EXPECT_EQ(answer.begun, tape_time_us(2000));
  EXPECT_EQ(answer.at, tape_time_us(4000));
}

TEST(ExcerptAnswer, OfALongOneTheBeginningIsKept) {
  const MemoryTape tape =
      MemoryTape().write(0, "a").read(1, std::string(16'000, 'x')).read(2, std::string(385, 'y'));
  const TapeAnswer answer = excerpt(tape, 0).steps.at(0).answer.value();
  EXPECT_EQ(answer.bytes.size(), 16'384U);
  EXPECT_EQ(answer.length, 16'385U);
}

TEST(ExcerptFrames, OfALongOneTheBeginningIsKept) {
  const MemoryTape tape = MemoryTape().write(0, std::string(1025, 'x'));
  const TapeFrame frame = excerpt(tape, 0).steps.at(0).frame;
  EXPECT_EQ(frame.bytes.size(), 1024U);
  EXPECT_EQ(frame.length, 1025U);
  EXPECT_FALSE(frame.is(frame.bytes));
}

TEST(ExcerptFrames, ARequestWithoutEndIsCutSomewhere) {
  const std::string half(32'768, 'x');
  EXPECT_EQ(excerpt(MemoryTape().write(0, half).write(1, half).write(2, "y"), 0).steps.size(), 2U);
  EXPECT_EQ(excerpt(MemoryTape().write(0, half).write(1, half.substr(1)).write(2, "y"), 0).steps.size(), 1U);
}

TEST(ExcerptReach, HoldsTheFrameOfTheOffset) {
  const MemoryTape tape = MemoryTape().write(0, "ab").read(1, "-").write(2, "cd").read(3, "-");
  EXPECT_EQ(excerpt(tape, 1).place, 0U);
  EXPECT_EQ(excerpt(tape, 2).place, 1U);
  EXPECT_EQ(excerpt(tape, 4).place, 2U) << "behind the end";
}

TEST(ExcerptReach, IsThirtyTwoFramesBefore) {
  const TapeExcerpt all = excerpt(exchanges(33), 32);
  EXPECT_EQ(all.place, 32U);
  EXPECT_TRUE(all.from_start);
  const TapeExcerpt most = excerpt(exchanges(34), 33);
  EXPECT_EQ(most.place, 32U);
  EXPECT_FALSE(most.from_start);
  EXPECT_EQ(most.steps.front().frame.exchange, 2U);
}

TEST(ExcerptReach, IsThirtyTwoFramesBehind) {
  const TapeExcerpt all = excerpt(exchanges(33), 0);
  EXPECT_EQ(all.steps.size(), 33U);
  const TapeExcerpt most = excerpt(exchanges(100), 0);
  EXPECT_EQ(most.steps.size(), 33U);
  EXPECT_FALSE(most.to_end);
  EXPECT_TRUE(excerpt(exchanges(10), 0).to_end);
}

TEST(ExcerptReach, WhatWasNotPlayedIsLeftOut) {
  const MemoryTape tape = exchanges(4);
  TapeExcerpt found = excerpt(tape, 3);
  begin_at(found, tape_time_us(1000));
  EXPECT_EQ(found.steps.size(), 3U);
  EXPECT_EQ(found.place, 2U);
  EXPECT_EQ(found.steps.front().frame.exchange, 2U);
  begin_at(found, tape_time_us(1'000'000));
  EXPECT_EQ(found.place, 0U);
  EXPECT_EQ(found.steps.size(), 1U) << "the place itself stays";
}

TEST(ExcerptRead, GivesUpWhenAskedAndWhereTheTapeIsDamaged) {
  MemoryTape tape;
  for (unsigned i = 0; i < kRecordsBetweenLooks; ++i) tape.write(0, "x");
  MemorySource source(tape);
  EXPECT_FALSE(read_excerpt(source, 999'999, kFrameGap, [] { return true; }).has_value());
  EXPECT_EQ(source.calls(), kRecordsBetweenLooks - 1) << "it looks once in so many records";
  EXPECT_TRUE(read_excerpt(source, 999'999, kFrameGap, [] { return false; }).has_value());
  MemorySource damaged(tape);
  damaged.fail_at(1);
  EXPECT_FALSE(read_excerpt(damaged, 999'999, kFrameGap).has_value());
}

}  // namespace
}  // namespace porttape::test
