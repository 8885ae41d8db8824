// What is said of bytes that were recorded as read and that the driver did not read.

#include <optional>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/report.hpp"

namespace porttape {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

RunReport passed() {
  RunReport report;
  report.tape = "laser.log";
  report.from_driver_bytes = report.from_driver_matched = 42;
  report.from_driver_of = 42;
  return report;
}

// A run that passed, whose tape speaks 100 bytes, of which so many were delivered and left.
RunReport spoken_to(std::uint64_t delivered, std::optional<std::uint64_t> left) {
  RunReport report = passed();
  report.to_driver_bytes = delivered;
  report.to_driver_of = 100;
  report.left_unread = left;
  return report;
}

std::string doubts_of(const RunReport& report) {
  std::string all;
  for (const Doubt& doubt : report.doubts) all += doubt.text + '\n';
  return all;
}

TEST(JudgeReading, WhatWasReadIsNothing) {
  for (const bool must_read : {false, true}) {
    RunReport report = spoken_to(100, 0);
    report.must_read = must_read;
    judge_reading(report);
    EXPECT_EQ(report.verdict, Verdict::pass);
    EXPECT_EQ(report.unread, std::nullopt);
    EXPECT_EQ(doubts_of(report), "");
  }
}

TEST(JudgeReading, WhatIsNotKnownIsADoubtOfWhoeverMustRead) {
  RunReport report = spoken_to(100, std::nullopt);
  judge_reading(report);
  EXPECT_EQ(doubts_of(report), "");
  report.must_read = true;
  judge_reading(report);
  EXPECT_EQ(doubts_of(report), "") << "there was nothing to tell";
  report.left_untold = true;
  judge_reading(report);
  EXPECT_EQ(report.verdict, Verdict::pass);
  EXPECT_EQ(report.unread, std::nullopt);
  EXPECT_EQ(doubts_of(report),
            "what the driver left unread when it closed is not known: the kernel did not tell it\n");
}

TEST(JudgeReading, WhatWasNotIsADoubtWithItsShare) {
  const auto judged = [](std::uint64_t delivered, std::optional<std::uint64_t> left,
                         std::uint64_t excused = 0) {
    RunReport report = spoken_to(delivered, left);
    report.reads_excused = excused;
    judge_reading(report);
    EXPECT_EQ(report.verdict, Verdict::pass);
    return doubts_of(report);
  };
  EXPECT_EQ(judged(100, 1),
            "1 byte of 100 (1.0 %) that was recorded as read was not read; --must-read makes that the "
            "verdict\n");
  EXPECT_EQ(judged(90, std::nullopt),
            "10 bytes of 100 (10.0 %) that were recorded as read were not read; --must-read "
            "makes that the verdict\n");
  EXPECT_THAT(judged(90, 30), HasSubstr("40 bytes of 100 (40.0 %)"));
  EXPECT_THAT(judged(60, 0, 30), HasSubstr("10 bytes of 100"));
  EXPECT_EQ(judged(60, 0, 40), "");
  EXPECT_EQ(judged(60, 0, 41), "") << "more was dropped than was to come";
}

TEST(JudgeReading, WhereALineThatTellsItCouldNotThatIsADoubtForAll) {
  RunReport report = spoken_to(100, std::nullopt);
  report.left_unseen = true;
  judge_reading(report);
  EXPECT_EQ(report.verdict, Verdict::pass);
  EXPECT_THAT(doubts_of(report), StartsWith("what the driver left unread when it closed is not known"));
}

TEST(JudgeReading, WhereALineNeverTellsItThatIsADoubtOfATapeThatOnlySpeaks) {
  RunReport asked = spoken_to(100, std::nullopt);
  asked.left_untold = true;
  RunReport spoken = asked;
  spoken.from_driver_bytes = spoken.from_driver_matched = 0;
  spoken.from_driver_of = 0;
  judge_reading(asked);
  EXPECT_EQ(doubts_of(asked), "");
  judge_reading(spoken);
  EXPECT_EQ(spoken.verdict, Verdict::pass);
  EXPECT_THAT(doubts_of(spoken), StartsWith("what the driver left unread when it closed is not known"));
}

TEST(JudgeReading, ThatNothingCameIsADoubtHoweverTheRunWasSteered) {
  const auto judged = [](std::uint64_t delivered, const auto& change) {
    RunReport report = spoken_to(delivered, 0);
    change(report);
    judge_reading(report);
    EXPECT_EQ(report.verdict, Verdict::pass);
    return doubts_of(report);
  };
  const auto paused = [](RunReport& report) { report.playback.pauses = 1; };
  EXPECT_THAT(judged(0, paused), StartsWith("nothing of the 100 bytes that were recorded as read came"));
  EXPECT_EQ(judged(1, paused), "");
  EXPECT_THAT(judged(0, [](RunReport& report) { report.playback.rates = 1; }), StartsWith("nothing of"));
  EXPECT_THAT(judged(0, [](RunReport& report) { report.leaves_out = true; }), StartsWith("nothing of"));
  EXPECT_EQ(judged(0,
                   [](RunReport& report) {
                     report.leaves_out = true;
                     report.reads_excused = 100;
                   }),
            "");
}

TEST(JudgeReading, WhatADriverDroppedBesidesTheTapeIsADoubtWhereItMatters) {
  RunReport report = spoken_to(100, 0);
  report.left_flushed = true;
  RunReport must_read = report;
  must_read.must_read = true;
  RunReport spoken = report;
  spoken.from_driver_bytes = spoken.from_driver_matched = 0;
  spoken.from_driver_of = 0;
  judge_reading(report);
  EXPECT_EQ(doubts_of(report), "");
  for (RunReport* each : {&must_read, &spoken}) {
    judge_reading(*each);
    EXPECT_EQ(each->verdict, Verdict::pass);
    EXPECT_THAT(doubts_of(*each), StartsWith("the driver dropped what had come to it (tcflush)"));
  }
}

TEST(JudgeReading, WhatWasLeftInEachSessionCounts) {
  RunReport report = spoken_to(100, 10);
  report.left_unread_before = 30;
  report.must_read = true;
  judge_reading(report);
  EXPECT_EQ(report.verdict, Verdict::incomplete);
  EXPECT_EQ(report.unread, 40U);
}

TEST(JudgeReading, ATapeThatOnlySpeaksIsIgnoredByADriverThatLeavesAllInEverySession) {
  RunReport report = spoken_to(100, 40);
  report.from_driver_bytes = report.from_driver_matched = 0;
  report.from_driver_of = 0;
  report.left_unread_before = 60;
  judge_reading(report);
  EXPECT_EQ(report.verdict, Verdict::incomplete);
  EXPECT_EQ(report.unread, 100U);
}

TEST(JudgeReading, ASmallShareIsNotNone) {
  RunReport report = spoken_to(100'000, 9);
  report.to_driver_of = 100'000;
  judge_reading(report);
  EXPECT_THAT(doubts_of(report), HasSubstr("9 bytes of 100000 (less than 0.1 %)"));
}

TEST(JudgeReading, MustReadMakesItTheVerdict) {
  RunReport report = spoken_to(100, 1);
  report.must_read = true;
  judge_reading(report);
  EXPECT_EQ(report.verdict, Verdict::incomplete);
  EXPECT_EQ(exit_status_of(report), 5);
  EXPECT_EQ(doubts_of(report), "");
  EXPECT_THAT(to_json(report), HasSubstr(R"("cause":"unread")"));
  EXPECT_THAT(to_json(report), HasSubstr(R"("unread":1,)"));
  EXPECT_THAT(to_text(report),
              StartsWith("incomplete: the driver did not read 1 of 100 bytes that were recorded as read\n"
                         "  laser.log: from the driver 42 of 42 bytes"));
}

TEST(JudgeReading, ATapeThatOnlySpeaksIsToBeListenedTo) {
  RunReport none = spoken_to(70, 70);
  none.from_driver_bytes = none.from_driver_matched = 0;
  none.from_driver_of = 0;
  RunReport one = none;
  one.left_unread = 69;
  RunReport loose = none;
  loose.strictness = 0;
  judge_reading(none);
  EXPECT_EQ(none.verdict, Verdict::incomplete);
  judge_reading(one);
  EXPECT_EQ(one.verdict, Verdict::pass);
  EXPECT_THAT(doubts_of(one), HasSubstr("99 bytes of 100"));
  judge_reading(loose);
  EXPECT_EQ(loose.verdict, Verdict::pass);
  EXPECT_EQ(doubts_of(loose), "100 bytes of 100 (100.0 %) that were recorded as read were not read\n");
}

TEST(JudgeReading, ADriverThatIgnoresATapeThatOnlySpeaksNeverPasses) {
  const auto judged = [](const auto& change) {
    RunReport report = spoken_to(0, 0);
    report.from_driver_bytes = report.from_driver_matched = 0;
    report.from_driver_of = 0;
    change(report);
    judge_reading(report);
    return report.verdict;
  };
  EXPECT_EQ(judged([](RunReport& report) { report.lookup.emplace(); }), Verdict::incomplete);
  EXPECT_EQ(judged([](RunReport& report) { report.playback.pauses = 1; }), Verdict::incomplete);
  EXPECT_EQ(judged([](RunReport& report) { report.leaves_out = true; }), Verdict::incomplete);
  EXPECT_EQ(judged([](RunReport& report) {
              report.playback.loops = 1;
              report.playback.loops_complete = 0;
              report.playback.loops_of.reset();
            }),
            Verdict::incomplete);
  EXPECT_EQ(judged([](RunReport& report) { report.reads_excused = 100; }), Verdict::pass)
      << "nothing of it could be read";
  EXPECT_EQ(judged([](RunReport& report) { report.to_driver_of = 0; }), Verdict::pass);
}

TEST(JudgeReading, WhereWhatWasDueIsNotKnownWhoeverMustReadIsToldSo) {
  RunReport report = spoken_to(50, 0);
  report.leaves_out = report.closed = true;
  judge_reading(report);
  EXPECT_EQ(doubts_of(report), "");
  report.must_read = true;
  judge_reading(report);
  EXPECT_EQ(report.verdict, Verdict::pass);
  EXPECT_THAT(doubts_of(report),
              StartsWith("whether the driver read all that it should have is not known: "));
}

TEST(JudgeReading, WhereTheTapesLengthSaysNothingOnlyWhatIsCertainCounts) {
  const auto judged = [](const auto& change) {
    RunReport report = spoken_to(50, 7);
    change(report);
    judge_reading(report);
    return report.unread;
  };
  EXPECT_EQ(judged([](RunReport&) {}), 57U);
  EXPECT_EQ(judged([](RunReport& report) { report.lookup.emplace(); }), 7U);
  EXPECT_EQ(judged([](RunReport& report) { report.playback.seeks = 1; }), 7U);
  EXPECT_EQ(judged([](RunReport& report) { report.to_driver_of.reset(); }), 7U);
}

TEST(JudgeReading, RulesOfWritesLeaveTheAnswersAsLongAsTheyAre) {
  RunReport report = spoken_to(50, 7);
  report.ruled = true;
  report.reads_excused = 20;
  judge_reading(report);
  EXPECT_EQ(report.unread, 37U);
}

TEST(JudgeReading, TheAnswerOfAFrameThatMayBeLeftOutIsNotMissed) {
  RunReport report = spoken_to(50, 7);
  report.ruled = report.leaves_out = true;
  judge_reading(report);
  EXPECT_EQ(report.unread, 7U);
}

TEST(JudgeReading, OfRewrittenAnswersTheTapesBytesCount) {
  const auto judged = [](std::uint64_t rewritten, std::uint64_t delivered) {
    RunReport report = spoken_to(rewritten, 0);
    report.rewritten = true;
    report.delivered = delivered;
    judge_reading(report);
    return report.unread;
  };
  EXPECT_EQ(judged(90, 100), std::nullopt);
  EXPECT_EQ(judged(110, 98), 2U);
}

TEST(JudgeReading, OfEndlessLoopsThoseThatWereCompleteCount) {
  const auto judged = [](std::uint64_t loops, std::uint64_t complete, std::uint64_t delivered) {
    RunReport report = spoken_to(delivered, 0);
    report.playback.loops = loops;
    report.playback.loops_complete = complete;
    report.playback.loops_of.reset();
    report.playback.prerolled.reads = 10;
    report.to_driver_of = 10 + 90 * loops;
    judge_reading(report);
    return report.unread;
  };
  EXPECT_EQ(judged(1, 1, 0), 100U);
  EXPECT_EQ(judged(1, 0, 10), std::nullopt);
  EXPECT_EQ(judged(3, 2, 190), std::nullopt);
  EXPECT_EQ(judged(3, 3, 190), std::nullopt) << "the last one ends where the driver is stopped";
  EXPECT_EQ(judged(3, 2, 189), 1U);
}

TEST(JudgeReading, UnderLookupTheAnswersThatWereAskedForCount) {
  RunReport report = spoken_to(30, 5);
  report.lookup.emplace();
  report.lookup->undelivered = 10;
  judge_reading(report);
  EXPECT_EQ(report.unread, 15U);
  EXPECT_THAT(doubts_of(report), HasSubstr("15 bytes of 40 (37.5 %) that were recorded as read"));
}

TEST(JudgeReading, AtStrictness0ItIsNoVerdict) {
  RunReport report = spoken_to(50, 7);
  report.must_read = true;
  report.strictness = 0;
  judge_reading(report);
  EXPECT_EQ(report.verdict, Verdict::pass);
  EXPECT_THAT(doubts_of(report), HasSubstr("were not read; at strictness 0 that is no verdict\n"));
}

TEST(JudgeReading, OtherVerdictsStay) {
  const auto judged = [](const auto& change) {
    RunReport report = spoken_to(50, 7);
    report.must_read = true;
    change(report);
    const Verdict before = report.verdict;
    judge_reading(report);
    EXPECT_EQ(report.verdict, before);
    return report.unread;
  };
  EXPECT_EQ(judged([](RunReport& report) { report.verdict = Verdict::data_mismatch; }), std::nullopt);
  EXPECT_EQ(judged([](RunReport& report) { report.writer = Writer::device; }), std::nullopt);
  EXPECT_EQ(judged([](RunReport& report) { report.nobody_came = true; }), std::nullopt);
}

TEST(JudgeReading, ATenthOfAPercentIsAShare) {
  const auto doubt = [](std::uint64_t unread) {
    RunReport report = passed();
    report.to_driver_of = report.to_driver_bytes = 10'000;
    report.left_unread = unread;
    judge_reading(report);
    return report.doubts.at(0).text;
  };
  EXPECT_THAT(doubt(10), HasSubstr("(0.1 %)"));
  EXPECT_THAT(doubt(9), HasSubstr("(less than 0.1 %)"));
}

TEST(JudgeReading, WhatIsMoreThanTheTapeHasHasNoShare) {
  RunReport report = passed();
  report.to_driver_of = report.to_driver_bytes = 10;
  report.playback.seeks = 1;
  report.left_unread = 11;
  RunReport all = report;
  all.left_unread = 10;
  judge_reading(report);
  judge_reading(all);
  EXPECT_THAT(report.doubts.at(0).text, StartsWith("11 bytes that were recorded"));
  EXPECT_THAT(all.doubts.at(0).text, StartsWith("10 bytes of 10 (100.0 %) that were"));
  EXPECT_EQ(all.doubts.at(0).kind, Doubt::Kind::unread);
}

TEST(JudgeReading, ADriverThatIsAskedForNothingButReadsIsJudgedByThat) {
  RunReport report = passed();
  report.from_driver_of = 1;
  report.to_driver_of = report.left_unread = report.to_driver_bytes = 10;
  judge_reading(report);
  EXPECT_EQ(report.verdict, Verdict::pass) << "the tape does not only speak";
}

}  // namespace
}  // namespace porttape
