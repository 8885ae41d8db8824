// What a run keeps, tells and looks through: at each limit, and one beyond.

#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/request_index.hpp"
#include "libport/replay/write_stream.hpp"
#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

using testing::StartsWith;

ReplayConfig with(Match match, OnMismatch on_mismatch) {
  ReplayConfig config;
  config.match = match;
  config.on_mismatch = on_mismatch;
  return config;
}

TEST(MismatchLimits, ThirtyTwoBytesAreShownAndAKilobyteIsKept) {
  const MemoryTape tape = MemoryTape().write(0, std::string(40, 'b') + std::string(40, 'e'));
  Rig rig(tape, failing());
  rig.open().write(std::string(40, 'b') + std::string(2000, 'g'));
  const Mismatch& mismatch = rig.mismatches.at(0);
  EXPECT_EQ(mismatch.before, Bytes(32, 'b'));
  EXPECT_EQ(mismatch.expected, Bytes(32, 'e'));
  EXPECT_EQ(mismatch.got, Bytes(32, 'g'));
  EXPECT_EQ(mismatch.came, Bytes(1024, 'g'));
  EXPECT_EQ(mismatch.block_before, 40U);
  EXPECT_EQ(mismatch.block_after, 40U);
}

TEST(MismatchLimits, WhatWasRightIsKeptByteByByteToo) {
  const MemoryTape tape = MemoryTape().write(0, "0123456789012345678901234567890123456789.");
  Rig rig(tape, failing());
  rig.open().write_bytewise("0123456789012345678901234567890123456789").write("!");
  EXPECT_EQ(as_text(rig.mismatches.at(0).before), "89012345678901234567890123456789");
}

TEST(MismatchLimits, UnderWarnWhatFollowsIsKeptUpToAKilobyte) {
  Rig rig(MemoryTape().write(0, "abc"), with(Match::sequence, OnMismatch::warn));
  rig.open().write("X").write(std::string(1000, 'y')).write(std::string(100, 'z')).finish();
  const Bytes& came = rig.report->mismatch->came;
  EXPECT_EQ(came.size(), 1024U);
  EXPECT_EQ(came.front(), 'X');
  EXPECT_EQ(came.at(1000), 'y');
  EXPECT_EQ(came.at(1001), 'z');
}

TEST(MismatchLimits, ThirtyTwoBytesOfWhatNeverCameAreShown) {
  Rig rig(MemoryTape().write(0, std::string(40, 'e')), failing());
  EXPECT_EQ(rig.open().finish(), Verdict::incomplete);
  EXPECT_EQ(rig.report->next_expected.size(), 32U);
}

TEST(MismatchLimits, OfATimingMismatchThirtyTwoBytesAreShown) {
  Rig rig(MemoryTape().write(0, std::string(33, 'a')), failing(2));
  rig.open().wait(200'000).write(std::string(33, 'a'));
  EXPECT_EQ(rig.verdict(), Verdict::timing_mismatch);
  EXPECT_EQ(rig.report->mismatch->got.size(), 32U);
  EXPECT_EQ(rig.report->mismatch->expected.size(), 32U);
}

TEST(MismatchLimits, SixteenAreToldAtOnceAndAllAreCounted) {
  MemoryTape tape;
  for (int i = 0; i < 17; ++i) tape.write(i * 10'000, "ask").read(i * 10'000 + 1, "-");
  ReplayConfig config = with(Match::lookup, OnMismatch::warn);
  Rig rig(tape, config);
  rig.open().wait(1);
  for (int i = 0; i < 17; ++i) {
    rig.clock(1'000'000);
    rig.engine.on_write(rig.now(), as_bytes("no"));
  }
  rig.advance();
  EXPECT_EQ(rig.mismatches.size(), 16U);
  rig.finish();
  EXPECT_EQ(rig.report->mismatches, 17U);
}

TEST(MismatchLimits, TheWriteThatItIsInIsKnownAndOneThatBeganBeforeIsNot) {
  const MemoryTape tape = MemoryTape().write(0, "abcdef");
  Rig rig(tape, failing());
  rig.open().write("ab").write("Xd");
  EXPECT_EQ(rig.mismatches.at(0).write, 2U);
  EXPECT_EQ(rig.mismatches.at(0).write_offset, 0U);
}

// A tape with so many gaps, and the doubts of a driver that comes to all.
std::vector<Doubt> doubts_of_gaps(int count, std::uint64_t bytes) {
  MemoryTape tape;
  tape.write(0, "a");
  for (int i = 1; i <= count; ++i) tape.gap(i * 1000, bytes, i * 1000 - 500);
  tape.write((count + 1) * 1000, "b");
  Rig rig(tape);
  rig.open().write("a").wait(1'000'000).write("b");
  rig.finish();
  return rig.report->doubts;
}

TEST(DoubtLimits, EightGapsAreToldAndTheRestIsCounted) {
  EXPECT_EQ(doubts_of_gaps(8, 1).size(), 8U);
  const std::vector<Doubt> more = doubts_of_gaps(10, 1);
  ASSERT_EQ(more.size(), 9U);
  EXPECT_EQ(more.back(), (Doubt{Doubt::Kind::gap, "and 2 more gaps"}));
}

TEST(DoubtLimits, AGapWithoutBytesMissesSomething) {
  EXPECT_THAT(doubts_of_gaps(1, 0).at(0).text, StartsWith("something is missing on the tape from "));
  EXPECT_THAT(doubts_of_gaps(1, 1).at(0).text, StartsWith("1 bytes are missing on the tape from "));
}

TEST(LookupLimits, SixtyFourRequestsThatNobodyAskedForAreListed) {
  MemoryTape tape;
  for (int i = 0; i < 66; ++i) tape.write(i * 1000, "q" + std::to_string(100 + i)).read(i * 1000 + 1, "-");
  Rig rig(tape, with(Match::lookup, OnMismatch::warn));
  rig.open().wait(1).write("q100").wait(10'000).finish();
  EXPECT_EQ(rig.report->lookup->never_asked.size(), 64U);
  EXPECT_EQ(rig.report->lookup->asked, 1U);
  EXPECT_EQ(rig.report->lookup->requests, 66U);
}

TEST(LookupLimits, OfALongRequestThirtyTwoBytesAreShown) {
  Rig rig(MemoryTape().write(0, std::string(40, 'q')).read(1, "-"), with(Match::lookup, OnMismatch::warn));
  rig.open().wait(1).finish();
  const LookupReport::Request& never = rig.report->lookup->never_asked.at(0);
  EXPECT_EQ(never.bytes.size(), 32U);
  EXPECT_EQ(never.size, 40U);
}

TEST(LookupLimits, AnUnknownRequestIsHeldAgainstTheNearest) {
  const MemoryTape tape = MemoryTape()
                              .open(0)
                              .write(1000, "ask" + std::string(40, '1'))
                              .read(2000, "-")
                              .write(3000, "get")
                              .read(4000, "-");
  Rig rig(tape, with(Match::lookup, OnMismatch::fail));
  rig.open().wait(1).write("ask1" + std::string(2000, '2'));
  const Mismatch& mismatch = rig.mismatches.at(0);
  EXPECT_EQ(mismatch.kind, MismatchKind::data);
  EXPECT_EQ(mismatch.offset, 4U);
  EXPECT_EQ(mismatch.tape_offset, 4U);
  EXPECT_EQ(mismatch.exchange, 1U);
  EXPECT_EQ(mismatch.tape, tape_time_us(1000));
  EXPECT_EQ(as_text(mismatch.before), "ask1");
  EXPECT_EQ(mismatch.expected, Bytes(32, '1'));
  EXPECT_EQ(mismatch.got, Bytes(32, '2'));
  EXPECT_EQ(mismatch.came, Bytes(1024, '2'));
  EXPECT_EQ(mismatch.block_before, 4U);
  EXPECT_EQ(mismatch.block_after, 39U);
}

TEST(LookupLimits, WhatIsCutOffIsReportedWithItsPlace) {
  const MemoryTape tape = MemoryTape().write(0, "a").read(1, "-").write(7000, "question").read(8000, "-");
  Rig rig(tape, with(Match::lookup, OnMismatch::warn));
  rig.open().wait(1).write("quest").wait(1);
  EXPECT_EQ(rig.finish(), Verdict::incomplete);
  EXPECT_EQ(as_text(rig.report->next_expected), "ion");
  EXPECT_EQ(as_text(rig.report->next_expected_before), "quest");
  EXPECT_EQ(rig.report->next_expected_block, 3U);
  EXPECT_EQ(rig.report->next_expected_offset, 6U);
  EXPECT_EQ(rig.report->next_expected_tape, tape_time_us(7000));
}

// Exchanges 10 ms apart: "ask1\n", "ask2\n", … The answer comes 1 ms after its question.
MemoryTape numbered(int count) {
  MemoryTape tape;
  tape.open(0);
  for (int i = 1; i <= count; ++i) {
    tape.write(i * 10'000, "ask" + std::to_string(i) + "\n").read(i * 10'000 + 1000, std::to_string(i));
  }
  return tape.close((count + 1) * 10'000);
}

// What a report says of where the tape goes on, when the driver asks for these in turn.
std::string went_on(const std::vector<int>& asked) {
  Rig rig(numbered(5), with(Match::sequence, OnMismatch::resync));
  rig.open();
  for (const int i : asked) rig.write("ask" + std::to_string(i) + "\n").wait(2000);
  rig.close();
  return rig.report->mismatch ? rig.report->mismatch->went_on : "as recorded";
}

TEST(ResyncText, SaysHowManyRequestsLieBetween) {
  EXPECT_EQ(went_on({1, 2, 3, 4, 5}), "as recorded");
  EXPECT_EQ(went_on({1, 3}), "the tape goes on at 0.030000 s: 1 request skipped");
  EXPECT_EQ(went_on({1, 4}), "the tape goes on at 0.040000 s: 2 requests skipped");
  EXPECT_EQ(went_on({1, 2, 2}), "the tape goes back 1 request and on at 0.020000 s");
  EXPECT_EQ(went_on({1, 2, 1}), "the tape goes back 2 requests and on at 0.010000 s");
}

TEST(ResyncText, ALaterJumpIsAMismatchWithWhatWasNext) {
  Rig rig(numbered(5), with(Match::sequence, OnMismatch::resync));
  rig.open();
  for (const int i : {1, 3, 5}) rig.write("ask" + std::to_string(i) + "\n").wait(2000);
  ASSERT_EQ(rig.mismatches.size(), 2U);
  EXPECT_EQ(as_text(rig.mismatches[1].expected), "ask4\n");
  EXPECT_EQ(as_text(rig.mismatches[1].got), "ask5\n");
  EXPECT_EQ(rig.mismatches[1].offset, 10U);
  EXPECT_EQ(rig.mismatches[1].tape_offset, 15U);
  EXPECT_EQ(rig.mismatches[1].exchange, 4U);
  EXPECT_EQ(rig.mismatches[1].went_on, "the tape goes on at 0.050000 s: 1 request skipped");
}

TEST(ResyncText, UnknownBytesAreHeldAgainstWhatIsNext) {
  Rig rig(numbered(5), with(Match::sequence, OnMismatch::resync));
  rig.open();
  for (const int i : {1, 3}) rig.write("ask" + std::to_string(i) + "\n").wait(2000);
  rig.write("zzz").wait(100'000);
  ASSERT_EQ(rig.mismatches.size(), 2U);
  EXPECT_EQ(as_text(rig.mismatches[1].expected), "ask4\n");
  EXPECT_EQ(as_text(rig.mismatches[1].got), "zzz");
  EXPECT_EQ(rig.mismatches[1].tape_offset, 15U);
  EXPECT_EQ(rig.mismatches[1].exchange, 4U);
}

std::size_t bytes_of_index(const MemoryTape& tape) {
  MemorySource source(tape);
  Budget budget;
  RequestIndex index(source, budget, nullptr);
  while (!index.read_on()) budget.refill();
  return index.bytes();
}

TEST(RequestIndexLimits, AnExchangeCostsSeventyTwoBytesAndATextItsBytesAndSome) {
  const std::size_t one = bytes_of_index(MemoryTape().write(0, "ask").read(1, "-"));
  const std::size_t again =
      bytes_of_index(MemoryTape().write(0, "ask").read(1, "-").write(2, "ask").read(3, "-"));
  const std::size_t longer = bytes_of_index(MemoryTape().write(0, "longer").read(1, "-"));
  EXPECT_EQ(again - one, 72U);
  EXPECT_EQ(longer - one, 3U);
  EXPECT_EQ(one, 72U + 160 + 3);
}

TEST(RequestIndexLimits, AsMuchAsItMayNeedIsNoError) {
  const MemoryTape tape = MemoryTape().write(0, "ask").read(1, "-");
  const std::size_t needed = bytes_of_index(tape);
  for (const std::size_t most : {needed - 1, needed}) {
    MemorySource source(tape);
    Budget budget;
    RequestIndex index(source, budget, nullptr, most);
    EXPECT_EQ(index.read_on(), most == needed);
    EXPECT_EQ(index.error().has_value(), most != needed);
  }
}

TEST(RequestIndexLimits, AQuestionThatIsTooLongIsAnErrorBeforeItsEnd) {
  MemoryTape tape;
  for (int i = 0; i < 100; ++i) tape.write(i, std::string(100, 'q'));
  MemorySource source(tape);
  Budget budget;
  RequestIndex index(source, budget, nullptr, 1000);
  EXPECT_FALSE(index.read_on());
  EXPECT_EQ(source.calls(), 11U);
}

TEST(RequestIndexLimits, TheExchangeOfAByteIsTheOneThatHasIt) {
  const MemoryTape tape = MemoryTape().write(0, "abc").read(1, "-").write(2, "de").read(3, "-");
  MemorySource source(tape);
  Budget budget;
  RequestIndex index(source, budget, nullptr);
  ASSERT_TRUE(index.read_on());
  EXPECT_EQ(index.exchange_at(0), 0U);
  EXPECT_EQ(index.exchange_at(2), 0U);
  EXPECT_EQ(index.exchange_at(3), 1U);
  EXPECT_EQ(index.exchange_at(5), 2U) << "behind the last";
}

// What is ahead of the first byte of a stream, at that reach; "|" where it ends there.
std::string ahead(const MemoryTape& tape, const Expectation::Reach& reach) {
  MemorySource source(tape);
  Budget budget;
  WriteStream stream(source, budget);
  stream.rewind();
  EXPECT_EQ(stream.look(), WriteStream::State::bytes);
  EXPECT_EQ(stream.look_ahead(reach), WriteStream::State::bytes);
  const Expectation::Stretch stretch = stream.stretch();
  return std::string(as_text(stretch.ahead)) + (stretch.ahead_ends ? "|" : "");
}

TEST(WriteStreamLimits, WhatIsAheadIsAtLeastTheReach) {
  const MemoryTape tape = MemoryTape().write(0, "ab").write(1, "cd").write(2, "ef").write(3, "gh");
  EXPECT_EQ(ahead(tape, {.bytes = 0}), "");
  EXPECT_THAT(ahead(tape, {.bytes = 3}), StartsWith("cd"));
  EXPECT_THAT(ahead(tape, {.bytes = 5}), StartsWith("cdef"));
  EXPECT_EQ(ahead(tape, {.bytes = 100}), "cdefgh|");
}

TEST(WriteStreamLimits, WhatIsAheadEndsAtAPauseOfAtLeastSoLong) {
  const MemoryTape tape = MemoryTape().write(0, "ab").write(499, "cd").write(999, "ef");
  EXPECT_EQ(ahead(tape, {.bytes = 100, .pause = Micros{500}}), "cd|");
  EXPECT_EQ(ahead(tape, {.bytes = 100, .pause = Micros{501}}), "cdef|");
}

}  // namespace
}  // namespace porttape::test
