// match=lookup: any recorded request is answered whenever it comes.

#include <string>
#include <string_view>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/request_index.hpp"
#include "tests/replay/rig.hpp"

namespace porttape::test {
namespace {

using testing::HasSubstr;

ReplayConfig lookup(OnMismatch on_mismatch = OnMismatch::warn) {
  ReplayConfig config;
  config.match = Match::lookup;
  config.on_mismatch = on_mismatch;
  return config;
}

// Two polls, one of which has two answers.
MemoryTape two_polls() {
  return MemoryTape()
      .open(0)
      .write(1000, "Q1\r")
      .read(3000, "(230\r")
      .write(10'000, "F\r")
      .read(15'000, "#x\r")
      .write(20'000, "Q1\r")
      .read(22'000, "(231\r")
      .close(30'000);
}

TEST(Lookup, AnyRequestIsAnsweredInRecordedOrderThenTheLastAgain) {
  Rig rig(two_polls(), lookup());
  rig.open();
  EXPECT_EQ(rig.write("F\r").wait(5000).read(), "#x\r");
  EXPECT_EQ(rig.write("Q1\r").wait(2000).read(), "(230\r");
  EXPECT_EQ(rig.write("Q1\r").wait(2000).read(), "(231\r");
  EXPECT_EQ(rig.write("Q1\r").wait(2000).read(), "(231\r");
  EXPECT_EQ(rig.write("F\r").wait(5000).read(), "#x\r");
  EXPECT_EQ(rig.close().verdict(), Verdict::pass);
  const LookupReport& report = *rig.report->lookup;
  EXPECT_EQ(report.requests, 2U);
  EXPECT_EQ(report.asked, 2U);
  EXPECT_EQ(report.answered, 5U);
  EXPECT_EQ(report.unknown, 0U);
  EXPECT_THAT(to_text(*rig.report), HasSubstr("5 requests answered, 2 of the tape's 2 different ones"));
}

TEST(Lookup, BehindTheTapesEndEachRequestGetsItsLastAnswerInARunOfItsOwn) {
  ReplayConfig config = lookup();
  config.on_reopen = OnReopen::continue_;
  Rig rig(two_polls(), config);
  rig.open().write("Q1\r").wait(2000).write("F\r").wait(5000).write("Q1\r").wait(2000).close();
  ASSERT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->from_driver_matched, 8U);
  rig.read();
  for (int runs = 2; runs <= 3; ++runs) {
    rig.open().write("Q1\r").wait(2000).close();
    ASSERT_EQ(rig.runs, runs);
    EXPECT_EQ(rig.read(), "(231\r");
    EXPECT_EQ(rig.verdict(), Verdict::pass);
    EXPECT_EQ(rig.report->from_driver_bytes, 3U);
    EXPECT_EQ(rig.report->from_driver_matched, 3U);
    EXPECT_EQ(rig.report->lookup->asked, 1U);
    EXPECT_EQ(rig.report->lookup->answered, 1U);
  }
  rig.open().write("Q1\rZ").wait(100'000).close();
  ASSERT_EQ(rig.runs, 4);
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.report->mismatch->offset, 3U);
  EXPECT_EQ(rig.report->lookup->unknown, 1U);
}

TEST(Lookup, APollerThatPollsForEverLivesOnAShortTape) {
  Rig rig(two_polls(), lookup(OnMismatch::fail));
  rig.open();
  for (int i = 0; i < 1000; ++i) {
    ASSERT_EQ(rig.write("Q1\r").wait(1'000'000).read(), i == 0 ? "(230\r" : "(231\r");
  }
  EXPECT_EQ(rig.finish(), Verdict::pass);
}

TEST(Lookup, AnAnswerComesTheRecordedGapAfterItsRequestWasComplete) {
  ReplayConfig config = lookup();
  config.rate = 2;
  Rig rig(MemoryTape().write(1000, "ask").read(5000, "a").read(9000, "b"), config);
  rig.open().clock(50'000);
  rig.write("as").wait(10'000).write("k").wait(100'000);
  ASSERT_EQ(rig.deliveries.size(), 2U);
  EXPECT_EQ(rig.deliveries[0], (Rig::Delivery{62'000, "a", {1}}));
  EXPECT_EQ(rig.deliveries[1], (Rig::Delivery{64'000, "b", {1}}));
}

// This and the next were found by seeds of the simulation.
TEST(Lookup, AChangeOfTheRateCountsForWhatWasAskedBefore) {
  Rig rig(two_polls(), lookup());
  rig.open().write("F\rQ1\r").until(1000).rate(2).until(2999);
  EXPECT_EQ(rig.read(), "");
  EXPECT_EQ(rig.until(3000).read(), "#x\r(230\r") << "1 ms at the rate 1, 4 ms at 2";
  rig.write("F\r").wait(1000).rate(0.5).wait(5999);
  EXPECT_EQ(rig.read(), "");
  EXPECT_EQ(rig.wait(1).read(), "#x\r") << "1 ms at 2, 6 ms at 0.5";
}

TEST(Lookup, GapsThatAreTooLongAreCutInFrontOfAnAnswerAndInIt) {
  ReplayConfig config = lookup();
  config.max_gap = Micros{1000};
  Rig rig(
      MemoryTape().write(0, "Q").read(500'000, "A").read(500'200, "B").read(900'000, "C").hang_up(990'000),
      config);
  rig.open().write("Q").wait(1'000'000);
  EXPECT_EQ(rig.deliveries,
            (std::vector<Rig::Delivery>{{1000, "A", {1}}, {1200, "B", {1}}, {2200, "C", {1}}}));
  EXPECT_TRUE(rig.hung_up);
}

TEST(Lookup, WithoutTimesAnswersComeAtOnce) {
  ReplayConfig config = lookup();
  config.timing = Timing::none;
  Rig rig(MemoryTape().write(1000, "ask").read(5'000'000, "a"), config);
  EXPECT_EQ(rig.open().write("ask").read(), "a");
}

TEST(Lookup, WhatNobodyAskedForPlaysByTheClock) {
  Rig rig(MemoryTape().open(0).read(1000, "hello").write(5000, "q").read(6000, "a").read(500'000, "late"),
          lookup());
  rig.open().until(1000);
  EXPECT_EQ(rig.read(), "hello");
  rig.until(1'000'000);
  EXPECT_EQ(rig.read(), "");
  rig.write("q").wait(495'000);
  EXPECT_EQ(rig.read(), "alate") << "what follows a request is its answer, until the next one";
  EXPECT_EQ(rig.close().verdict(), Verdict::pass);
}

TEST(Lookup, AStreamThatIsNeverAskedPlaysByTheClock) {
  Rig rig(MemoryTape().read(1000, "a").read(2000, "b"), lookup());
  rig.open().until(3000).close();
  EXPECT_EQ(rig.delivered, "ab");
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Lookup, CutsNeverMatter) {
  for (std::size_t piece = 1; piece < 5; ++piece) {
    Rig rig(
        MemoryTape().write(0, "on").write(1000, "e\n").read(2000, "1").write(3000, "two\n").read(4000, "2"),
        lookup(OnMismatch::fail), true, piece);
    rig.open();
    rig.write_bytewise("two\n").wait(1000);
    rig.write("one\ntwo").write("\none\n").wait(10'000);
    EXPECT_EQ(rig.delivered, "2121");
    EXPECT_EQ(rig.close().verdict(), Verdict::pass);
  }
}

// "Q" is the beginning of "QMOD".
MemoryTape prefixes() {
  return MemoryTape()
      .write(0, "Q")
      .read(1000, "short")
      .write(9000, "QMOD")
      .read(9500, "long")
      .write(20'000, "D")
      .read(21'000, "d");
}

TEST(Lookup, ARequestThatBeginsALongerOneIsCompleteWhenTheDriverPauses) {
  Rig rig(prefixes(), lookup());
  rig.open().write("Q").wait(400);
  EXPECT_EQ(rig.wait(600).read(), "short") << "timed from its last byte, whatever the pause";
  EXPECT_EQ(rig.deliveries.back().us, 1000);
  rig.write("Q").wait(300).write("M").wait(300).write("OD").wait(500);
  EXPECT_EQ(rig.read(), "long");
  EXPECT_EQ(rig.close().verdict(), Verdict::pass);
}

TEST(Lookup, ARequestThatBeginsALongerOneIsCompleteWhenSomethingElseFollows) {
  Rig rig(prefixes(), lookup());
  rig.open().write("QDQ").wait(300);
  rig.write("D").wait(10'000);
  EXPECT_EQ(rig.delivered, "shortdshortd");
  EXPECT_EQ(rig.close().verdict(), Verdict::pass);
}

TEST(Lookup, ARequestThatBeginsALongerOneIsCompleteAtTheClose) {
  Rig rig(prefixes(), lookup());
  rig.open().write("Q").close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->lookup->answered, 1U);
}

TEST(Lookup, APauseInsideARequestIsNoEnd) {
  Rig rig(prefixes(), lookup());
  rig.open().write("D").wait(2000).write("QM").wait(1'000'000).write("OD").wait(1000);
  EXPECT_EQ(rig.delivered, "dlong");
}

TEST(Lookup, AnUnknownRequestIsAMismatchAndFails) {
  Rig rig(two_polls(), lookup(OnMismatch::fail));
  rig.open().write("Q2\r");
  EXPECT_TRUE(rig.hung_up);
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  ASSERT_EQ(rig.mismatches.size(), 1U);
  const Mismatch& mismatch = rig.mismatches.front();
  EXPECT_EQ(mismatch.offset, 1U);
  EXPECT_EQ(as_text(mismatch.before), "Q");
  EXPECT_EQ(as_text(mismatch.got), "2\r");
  EXPECT_EQ(as_text(mismatch.expected), "1\r");
  EXPECT_EQ(mismatch.tape_offset, 1U);
  EXPECT_EQ(mismatch.write, 1U);
}

TEST(Lookup, OfALongRequestTheLast32BytesBeforeTheDifferenceAreShown) {
  const std::string same(40, 'a');
  Rig rig(MemoryTape().write(0, same + "Q1" + same).read(1'000, "A"), lookup(OnMismatch::fail));
  rig.open().write(same + "Q2" + same);
  ASSERT_EQ(rig.mismatches.size(), 1U);
  EXPECT_EQ(as_text(rig.mismatches[0].before), same.substr(0, 31) + "Q");
  EXPECT_EQ(as_text(rig.mismatches[0].expected), "1" + same.substr(0, 31));
}

TEST(Lookup, UnderWarnAnUnknownRequestGoesToTheNextPauseAndHasNoAnswer) {
  Rig rig(two_polls(), lookup());
  rig.open().write("X").write("Q1\r").wait(100'000);
  EXPECT_EQ(rig.read(), "");
  EXPECT_EQ(rig.write("Q1\r").wait(2000).read(), "(230\r");
  EXPECT_EQ(rig.mismatches.size(), 1U);
  EXPECT_EQ(rig.close().verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.report->lookup->unknown, 1U);
}

TEST(Lookup, UnderResyncARequestIsFoundBehindUnknownBytes) {
  Rig rig(two_polls(), lookup(OnMismatch::resync));
  rig.open().write("QXQ1\r").wait(2000);
  EXPECT_EQ(rig.read(), "(230\r");
  EXPECT_EQ(rig.mismatches.size(), 1U);
  EXPECT_EQ(rig.mismatches.front().offset, 1U);
  EXPECT_EQ(rig.close().verdict(), Verdict::data_mismatch);
}

TEST(Lookup, AtStrictnessZeroAnUnknownRequestIsNone) {
  ReplayConfig config = lookup();
  config.strictness = 0;
  Rig rig(two_polls(), config);
  rig.open().write("what").wait(10'000).write("F\r").wait(10'000);
  EXPECT_EQ(rig.read(), "#x\r");
  EXPECT_EQ(rig.close().verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->lookup->unknown, 1U);
}

TEST(Lookup, AtStrictnessZeroNoSilenceStandsForAnOpen) {
  ReplayConfig config = lookup();
  config.strictness = 0;
  Rig rig(MemoryTape()
              .open(0)
              .read(1'000, "hello")
              .write(5'000, "ask")
              .read(6'000, "answer")
              .close(10'000)
              .open(20'000)
              .read(21'000, "hello again"),
          config);
  rig.open().wait(600'000'000);
  EXPECT_EQ(rig.read(), "hello");
  rig.close().open().wait(600'000'000);
  EXPECT_EQ(rig.read(), "hello again");
}

TEST(Lookup, WhatIsNeverAskedIsListedAndNoFailure) {
  Rig rig(two_polls(), lookup());
  rig.open().write("Q1\r").wait(2000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  ASSERT_EQ(rig.report->lookup->never_asked.size(), 1U);
  const LookupReport::Request& never = rig.report->lookup->never_asked.front();
  EXPECT_EQ(never, (LookupReport::Request{tape_time_us(10'000), 3, 2, Bytes{'F', '\r'}}));
  EXPECT_THAT(to_text(*rig.report), HasSubstr(R"(not asked "F\r", as the tape has it at 0.010000 s)"));
  EXPECT_THAT(
      to_json(*rig.report),
      HasSubstr(R"("lookup":{"requests":2,"asked":1,"answered":1,"unknown":0,"undelivered":0,"never_asked":[)"
                R"({"tape_us":10000,"offset":3,"size":2,"hex":"460d"}]})"));
}

TEST(Lookup, WhatWasAskedForAndNotWaitedForIsCounted) {
  Rig rig(two_polls(), lookup());
  rig.open().write("Q1\r").wait(2000).write("F\r").close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->lookup->undelivered, 3U) << "of F's answer; that of Q1 was delivered";
}

TEST(Lookup, AllThatWasWaitedForIsNotUndelivered) {
  Rig rig(two_polls(), lookup());
  rig.open().write("Q1\r").wait(2000).write("F\r").wait(5000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->lookup->undelivered, 0U);
}

TEST(Lookup, ARequestThatIsNotFinishedIsIncomplete) {
  Rig rig(two_polls(), lookup());
  rig.open().write("Q1").close();
  EXPECT_EQ(rig.verdict(), Verdict::incomplete);
  EXPECT_EQ(as_text(rig.report->next_expected), "\r");
  EXPECT_EQ(as_text(rig.report->next_expected_before), "Q1");
}

TEST(Lookup, AnswersToWhatIsWrittenAheadComeInTurn) {
  Rig rig(two_polls(), lookup());
  rig.open().write("F\rQ1\r").wait(4999);
  EXPECT_EQ(rig.read(), "");
  EXPECT_EQ(rig.wait(1).read(), "#x\r(230\r") << "never before the answer before it";
}

TEST(Lookup, ACloseLosesWhatWasNotDelivered) {
  Rig rig(two_polls(), lookup());
  rig.open().write("F\r").close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  rig.open().wait(100'000);
  EXPECT_EQ(rig.read(), "");
  EXPECT_EQ(rig.write("Q1\r").wait(2000).read(), "(230\r") << "another run begins with the first answers";
}

TEST(Lookup, AFlushDropsWhatIsDue) {
  Rig rig(MemoryTape().write(0, "q").read(1000, "a").read(9000, "b"), lookup());
  rig.open().blocked(true).write("q").wait(2000);
  rig.engine.on_event(rig.now(), line::Flush{});
  EXPECT_EQ(rig.settle().blocked(false).wait(10'000).read(), "b");
}

// A run is as many sessions as the tape has; each meets what its own begins with, and all answers are for
// all.
TEST(Lookup, TheSessionsOfATapeAreOneIndex) {
  const auto tape = MemoryTape()
                        .open(0)
                        .read(1000, "one>")
                        .write(2000, "a")
                        .read(3000, "A")
                        .close(4000)
                        .open(9000)
                        .read(9500, "two>")
                        .write(10'000, "b")
                        .read(11'000, "B")
                        .close(12'000);
  Rig rig(tape, lookup(OnMismatch::fail));
  rig.open().wait(1000);
  EXPECT_EQ(rig.write("b").wait(1000).read(), "one>B");
  rig.close();
  EXPECT_EQ(rig.runs, 0);
  rig.open().wait(500);
  EXPECT_EQ(rig.write("a").wait(1000).read(), "two>A");
  rig.close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->sessions_made, 2U);
}

TEST(Lookup, AHangUpBelongsToTheAnswerItStandsBehind) {
  Rig rig(MemoryTape().open(0).write(1000, "quit").read(2000, "bye").hang_up(5000), lookup());
  rig.open().until(100'000);
  EXPECT_FALSE(rig.hung_up);
  rig.write("quit").wait(3999);
  EXPECT_FALSE(rig.hung_up);
  rig.wait(1);
  EXPECT_TRUE(rig.hung_up);
}

TEST(Lookup, ADriverThatWritesNoMoreGetsItsAnswersAndThenTheEnd) {
  Rig rig(two_polls(), lookup(), true, 1000, {.half_closes = true});
  rig.open().write("F\r").end_writing();
  EXPECT_FALSE(rig.hung_up);
  rig.wait(5000);
  EXPECT_EQ(rig.read(), "#x\r");
  EXPECT_TRUE(rig.hung_up);
}

// Found by a seed of the simulation.
TEST(Lookup, ADeviceThatHasEndedItsSendingSaysNoMoreInThatSession) {
  const MemoryTape tape = MemoryTape()
                              .open(0)
                              .write(1000, "bye")
                              .read(2000, "so long")
                              .half_close(3000, Side::device)
                              .write(4000, "still here")
                              .read(5000, "no")
                              .close(6000);
  Rig rig(tape, lookup(), true, 1000, kSocket);
  rig.open().write("bye").write("bye").wait(1999);
  EXPECT_FALSE(rig.ended);
  EXPECT_EQ(rig.wait(1).read(), "so long");
  EXPECT_TRUE(rig.ended);
  rig.write("bye").wait(100'000);
  EXPECT_EQ(rig.read(), "");
  rig.close().open().write("bye").wait(100'000);
  EXPECT_EQ(rig.read(), "so long");
}

TEST(Lookup, WhatTheDeviceSaidBeforeItEndedItsSendingKeepsItsBlocks) {
  const MemoryTape tape = MemoryTape()
                              .open(0)
                              .read(1000, "hello")
                              .half_close(1000, Side::device)
                              .write(4000, "ask")
                              .read(5000, "no")
                              .close(6000);
  Rig rig(tape, lookup(), true, 1000, kSocket);
  rig.open().wait(1000);
  EXPECT_TRUE(rig.ended);
  EXPECT_EQ(rig.deliveries, (std::vector<Rig::Delivery>{{1000, "hello", {5}}}));
}

// In the tape's order such a read is a crafted one, or comes by a loop of the tape within one session.
TEST(HalfClosedDevice, SaysNoMoreInTheTapesOrderEither) {
  ReplayConfig config;
  config.loops = 2;
  Rig rig(MemoryTape().open(0).read(1000, "a").half_close(2000, Side::device).read(3000, "b"), config, true,
          1000, kSocket);
  rig.open().wait(20'000);
  EXPECT_EQ(rig.read(), "a");
  EXPECT_TRUE(rig.ended);
  EXPECT_EQ(rig.deliveries.size(), 1U);
}

TEST(Lookup, TheTapeIsUsedUpWhenAllOfItWasAskedFor) {
  ReplayConfig config = lookup();
  config.at_end = AtEnd::hangup;
  Rig rig(two_polls(), config);
  rig.open().write("Q1\r").wait(10'000).write("Q1\r").wait(10'000);
  EXPECT_FALSE(rig.hung_up);
  rig.write("F\r").wait(5000);
  EXPECT_TRUE(rig.hung_up);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Lookup, ADriverThatWritesNothingOnlyLooks) {
  Rig rig(two_polls(), lookup());
  rig.open().wait(1000).close();
  EXPECT_EQ(rig.report->from_driver_bytes, 0U);
  EXPECT_EQ(rig.verdict(), Verdict::pass);
}

TEST(Lookup, ALongTapeIsReadInSlicesAndTheDriverWaits) {
  MemoryTape tape;
  for (int i = 0; i < 20'000; ++i) tape.write(i * 100, "q" + std::to_string(i) + ";").read(i * 100 + 50, "a");
  Rig rig(tape, lookup());
  rig.engine.on_open(rig.now());
  rig.engine.on_write(rig.now(), as_bytes("q19999;"));
  EXPECT_GT(rig.engine.backlog(), 0U);
  EXPECT_LE(*rig.engine.next_deadline(), rig.now());
  rig.settle().wait(50);
  EXPECT_EQ(rig.read(), "a");
  EXPECT_EQ(rig.engine.backlog(), 0U);
}

TEST(Lookup, DamageOfTheTapeEndsTheRun) {
  Rig rig(two_polls(), lookup());
  rig.index.fail_at(4);
  rig.open().write("Q1\r");
  ASSERT_TRUE(rig.report);
  EXPECT_EQ(rig.report->trouble, "damaged at block 7");
}

TEST(Lookup, DamageOfAnAnswerEndsTheRun) {
  Rig rig(two_polls(), lookup());
  rig.answers.source().fail_at(1);
  rig.open().write("Q1\r").wait(2000).write("F\r").wait(10'000);
  EXPECT_EQ(rig.delivered, "(230\r");
  ASSERT_TRUE(rig.report);
  EXPECT_EQ(rig.report->trouble, "damaged at block 7");
}

TEST(Lookup, AnswersComeInPiecesToo) {
  ReplayConfig config = lookup();
  config.chunks = Chunks::bytes;
  Rig rig(two_polls(), config);
  rig.open().write("F\r").wait(5000);
  EXPECT_EQ(rig.read(), "#");
  EXPECT_TRUE(rig.engine.holds_piece());
  rig.engine.on_taken(rig.now());
  EXPECT_EQ(rig.settle().read(), "x");
  EXPECT_EQ(rig.wait(10'000).read(), "\r");
}

// What nobody asked for is under way when the driver asks, and the reverse: each comes whole.
TEST(Lookup, APieceIsOfOneReadUntilThatIsWhole) {
  ReplayConfig config = lookup();
  config.chunks = Chunks::bytes;
  const MemoryTape tape =
      MemoryTape().open(0).read(1000, "boot").read(9000, "up").write(20'000, "Q").read(21'000, "answer");
  const auto next_piece = [](Rig& rig) {
    rig.engine.on_taken(rig.now());
    return rig.settle().read();
  };
  Rig rig(tape, config);
  rig.open().wait(1000);
  EXPECT_EQ(rig.read(), "b");
  rig.write("Q").wait(2000);
  EXPECT_EQ(rig.read(), "") << "the driver has not read the piece before";
  std::string came;
  for (int pieces = 0; pieces < 9; ++pieces) came += next_piece(rig);
  EXPECT_EQ(came, "ootanswer");

  Rig other(tape, config);
  other.open().wait(1000);
  for (int pieces = 0; pieces < 4; ++pieces) next_piece(other);
  other.wait(6500).write("Q").wait(1000);
  EXPECT_EQ(other.read(), "a");
  other.stall(1000);
  came.clear();
  for (int pieces = 0; pieces < 7; ++pieces) came += next_piece(other);
  EXPECT_EQ(came, "nswerup");
}

// Digits may be any, and are one field of any length.
class AnyDigits final : public Expectation {
 public:
  [[nodiscard]] Held hold(const Stretch& recorded, ByteView came, Memory&) const override {
    const auto digits = [](ByteView bytes) {
      return static_cast<std::size_t>(
          std::ranges::find_if(bytes, [](Byte byte) { return byte < '0' || byte > '9'; }) - bytes.begin());
    };
    const std::size_t on_tape = digits(recorded.bytes);
    if (came.empty()) return {.recorded = on_tape};
    const std::size_t here = digits(came);
    if (on_tape > 0 && here > 0) return {.recorded = here < came.size() ? on_tape : 0, .came = here};
    if (on_tape > 0) return {.recorded = on_tape};
    const std::size_t text = std::min(recorded.bytes.size(), came.size());
    return exactly(recorded.bytes.first(1), came.first(std::min<std::size_t>(text, 1)));
  }
};

TEST(Lookup, RequestsThatMayComeForEachOtherAreOfOneKind) {
  const AnyDigits rule;
  Rig rig(MemoryTape()
              .write(0, "get 1\n")
              .read(1000, "first")
              .write(2000, "set 7\n")
              .read(3000, "done")
              .write(4000, "get 22\n")
              .read(5000, "second"),
          lookup(OnMismatch::fail), true, 1000, {.expectation = &rule});
  rig.open();
  EXPECT_EQ(rig.write("get 345\n").wait(1000).read(), "first");
  EXPECT_EQ(rig.write("set 0\n").wait(1000).read(), "done");
  EXPECT_EQ(rig.write_bytewise("get 1\n").wait(1000).read(), "second");
  EXPECT_EQ(rig.write("get 1\n").wait(1000).read(), "second");
  rig.write("got 1\n");
  EXPECT_EQ(rig.verdict(), Verdict::data_mismatch);
  EXPECT_EQ(rig.report->mismatch->offset, 8U + 6 + 6 + 6 + 1);
  EXPECT_EQ(rig.report->lookup->requests, 2U);
}

TEST(Lookup, AFieldWithoutAnEndIsEndedByThePause) {
  const AnyDigits rule;
  Rig rig(MemoryTape().write(0, "get 1").read(1000, "one"), lookup(), true, 1000, {.expectation = &rule});
  rig.open().write("get 12").wait(300).write("3").wait(1000);
  EXPECT_EQ(rig.read(), "one");
  EXPECT_EQ(rig.close().verdict(), Verdict::pass);
}

TEST(RequestIndexTest, WhatWouldTakeTooMuchMemoryIsAnErrorThatSaysWhatToDo) {
  MemoryTape tape;
  for (int i = 0; i < 1000; ++i) tape.write(i * 100, "q" + std::to_string(i)).read(i * 100 + 50, "a");
  MemorySource source(tape);
  Budget budget;
  RequestIndex index(source, budget, nullptr, 100'000);
  EXPECT_FALSE(index.read_on());
  ASSERT_TRUE(index.error());
  EXPECT_THAT(index.error()->message, HasSubstr("--session N"));
  EXPECT_LE(index.bytes(), 100'300U);
}

TEST(RequestIndexTest, PollsThatAreAlikeCostTheirPlacesAlone) {
  MemoryTape tape;
  for (int i = 0; i < 1000; ++i) tape.write(i * 100, std::string(1000, 'q')).read(i * 100 + 50, "a");
  MemorySource source(tape);
  Budget budget;
  RequestIndex index(source, budget, nullptr);
  for (bool whole = false; !whole; budget.refill()) whole = index.read_on();
  EXPECT_EQ(index.kinds(), 1U);
  EXPECT_EQ(index.exchanges(), 1000U);
  EXPECT_LT(index.bytes(), 100'000U);
}

}  // namespace
}  // namespace porttape::test
