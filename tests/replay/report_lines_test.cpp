// The further lines of a report for a person, and what decides whether they are there.

#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/report.hpp"
#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using test::bytes_of;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

RunReport passing() {
  RunReport report;
  report.from_driver_bytes = report.from_driver_matched = 42;
  report.from_driver_of = 42;
  return report;
}

RunReport incomplete() {
  RunReport report = passing();
  report.verdict = Verdict::incomplete;
  return report;
}

Mismatch one_byte() {
  Mismatch mismatch;
  mismatch.expected = bytes_of("a");
  mismatch.got = bytes_of("b");
  mismatch.block_after = 1;
  return mismatch;
}

RunReport differing_by(const Mismatch& mismatch) {
  RunReport report = passing();
  report.verdict = Verdict::data_mismatch;
  report.mismatch = mismatch;
  report.mismatches = 1;
  return report;
}

TEST(ReportLines, OneMismatchIsNotCounted) {
  RunReport report = differing_by(one_byte());
  EXPECT_THAT(to_text(report), Not(HasSubstr("mismatches in all")));
  report.mismatches = 2;
  EXPECT_THAT(to_text(report), HasSubstr("  mismatches in all: 2\n"));
}

TEST(ReportLines, WhatRulesLetPassIsToldBesideWhatCame) {
  RunReport report = passing();
  report.ruled = true;
  EXPECT_THAT(to_text(report), HasSubstr("42 of 42 bytes as recorded, to"));
  report.from_driver_bytes = 2;
  EXPECT_THAT(to_text(report), HasSubstr("42 of 42 bytes as recorded (by the rules; 2 came), to"));
  report.ruled = false;
  EXPECT_THAT(to_text(report), Not(HasSubstr("came)")));
  report = differing_by(one_byte());
  report.ruled = true;
  report.from_driver_bytes = 50;
  EXPECT_THAT(to_text(report), Not(HasSubstr("came)")));
}

TEST(ReportLines, OurTimersAreToldOfTimingAlone) {
  RunReport report = differing_by(one_byte());
  EXPECT_THAT(to_text(report), Not(HasSubstr("our own timers")));
  report.mismatch->kind = MismatchKind::timing;
  EXPECT_THAT(to_text(report), HasSubstr("our own timers"));
}

TEST(ReportLines, WhatARuleSaysAndWhereTheTapeGoesOnHaveTheirOwn) {
  Mismatch mismatch = one_byte();
  EXPECT_THAT(to_text(mismatch), AllOf(Not(HasSubstr("rule")), Not(HasSubstr("resync"))));
  mismatch.why = "the counter went back";
  mismatch.went_on = "the tape goes on at 1.000000 s";
  EXPECT_THAT(to_text(mismatch), HasSubstr("  rule      the counter went back\n"
                                           "  resync    the tape goes on at 1.000000 s\n"));
}

TEST(ReportLines, ALineThatCameIsShownToItsEndAlone) {
  Mismatch mismatch = one_byte();
  mismatch.expected = bytes_of("a\r");
  mismatch.block_after = 2;
  mismatch.got = bytes_of("b\rnext\r");
  EXPECT_THAT(to_text(mismatch), HasSubstr("the driver wrote \"b\\r\" where the tape has \"a\\r\"\n"));
  mismatch.got = bytes_of("b\nnext");
  EXPECT_THAT(to_text(mismatch), HasSubstr("the driver wrote \"b\\nnext\" where the tape has \"a\\r\"\n"));
}

TEST(ReportLines, SessionsThatTheDriverDidNotMakeAreToldOfAPassToo) {
  RunReport report = passing();
  report.sessions_of = 3;
  EXPECT_THAT(to_text(report), HasSubstr("  the tape has three sessions, the driver made one\n"));
  report.sessions_made = 3;
  EXPECT_THAT(to_text(report), Not(HasSubstr("sessions")));
  report.sessions_made = 1;
  report.nobody_came = true;
  EXPECT_THAT(to_text(report), Not(HasSubstr("sessions")));
}

TEST(ReportLines, WhereAllBytesCameWhatElseIsMissingIsTheHeadline) {
  RunReport report = incomplete();
  report.missed_half_close = tape_time_us(2'000'000);
  const std::string text = to_text(report);
  const std::string missing =
      "on the tape the driver ends its sending (half-close) at 2.000000 s; here it did not\n";
  EXPECT_THAT(text, StartsWith("incomplete: " + missing));
  EXPECT_THAT(text, AllOf(Not(HasSubstr("  " + missing)), Not(HasSubstr("never came"))));
  report.from_driver_matched = 41;
  EXPECT_THAT(to_text(report),
              AllOf(StartsWith("incomplete: recorded bytes never came from the driver\n"),
                    HasSubstr("  1 recorded byte never came from the driver\n"), HasSubstr("  " + missing)));
}

TEST(ReportLines, WhereTheTapeHasNothingOfTheDriversADriverThatNeverCameIsSaidToBeThat) {
  RunReport report = incomplete();
  report.nobody_came = true;
  report.from_driver_matched = 0;
  report.from_driver_of = 0;
  EXPECT_THAT(to_text(report), AllOf(StartsWith("incomplete: the driver never opened its port\n"),
                                     Not(HasSubstr("never came"))));
}

TEST(ReportLines, MoreThanTheTapeHasLeavesNothingMissing) {
  RunReport report = incomplete();
  report.from_driver_matched = 50;
  report.next_expected = bytes_of("x");
  report.next_expected_block = 1;
  EXPECT_THAT(to_text(report), HasSubstr("  0 recorded bytes never came from the driver\n"));
}

TEST(ReportLines, ATapeThatCouldNotPlayTheDriverToItsEndSaysSo) {
  RunReport report = incomplete();
  report.writer = Writer::device;
  EXPECT_THAT(to_text(report), StartsWith("incomplete: the tape was not played to its end\n"));
  report.sessions_of = 2;
  EXPECT_THAT(to_text(report), Not(HasSubstr("two sessions"))) << "the tape makes them";
}

TEST(ReportLines, SixteenMissingBytesAreShownOfOneWrite) {
  RunReport report = incomplete();
  report.next_expected = Bytes(20, 'x');
  report.next_expected_block = 17;
  std::string sixteen = "78";
  for (int i = 1; i < 16; ++i) sixteen += " 78";
  EXPECT_THAT(to_text(report), HasSubstr("writes: " + sixteen + '\n'));
  report.next_expected_block = 2;
  EXPECT_THAT(to_text(report), HasSubstr("writes: 78 78\n"));
}

// A number of settings of which the driver made the first.
RunReport without_settings(std::uint64_t missing) {
  RunReport report = passing();
  report.settings = {.recorded = missing + 1, .made = 1, .missing = {}};
  for (std::uint64_t i = 0; i < missing; ++i)
    report.settings.missing.push_back({tape_time_us(0), LineView::of(SeenSettings{.baud = 300U})});
  return report;
}

std::size_t count(const std::string& text, std::string_view what) {
  std::size_t found = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++found;
  return found;
}

TEST(ReportLines, EightSettingsAreToldAndTheRestIsCounted) {
  const std::string eight = to_text(without_settings(8));
  EXPECT_EQ(count(eight, "  settings  "), 8U);
  EXPECT_THAT(eight, Not(HasSubstr(" more\n")));
  const std::string nine = to_text(without_settings(9));
  EXPECT_EQ(count(nine, "  settings  "), 9U);
  EXPECT_THAT(nine, HasSubstr("  settings  and 1 more\n"));
}

TEST(ReportLines, TheOnlySettingIsNotCalledNoneOfThem) {
  RunReport report = without_settings(1);
  report.settings.recorded = 1;
  report.settings.made = 0;
  EXPECT_THAT(to_text(report), HasSubstr("  settings  the driver never made its line 300 baud"));
}

TEST(ReportLines, TroubleTakesTheHeadlineFromSettings) {
  RunReport report = without_settings(1);
  report.verdict = Verdict::settings_mismatch;
  report.trouble = "damaged";
  EXPECT_THAT(to_text(report), AllOf(StartsWith("failed: the tape could not be read on: damaged\n"),
                                     HasSubstr("  settings  the driver never made its line 300 baud")));
}

LookupReport asked_for(std::uint64_t asked, std::uint64_t of) {
  LookupReport lookup{.requests = of, .asked = asked, .answered = asked, .unknown = 0, .never_asked = {}};
  for (std::uint64_t i = asked; i < of; ++i)
    lookup.never_asked.push_back({tape_time_us(1'000'000), 0, 16, Bytes(16, 'r')});
  return lookup;
}

TEST(ReportLines, EightRequestsThatNobodyAskedForAreToldAndTheRestIsCounted) {
  RunReport report = passing();
  report.lookup = asked_for(2, 10);
  std::string text = to_text(report);
  EXPECT_EQ(count(text, "  not asked "), 8U);
  EXPECT_THAT(text, Not(HasSubstr(" more\n")));
  report.lookup = asked_for(1, 10);
  text = to_text(report);
  EXPECT_EQ(count(text, "  not asked "), 9U);
  EXPECT_THAT(text, HasSubstr("  not asked 1 more\n"));
}

TEST(ReportLines, SixteenBytesOfARequestThatNobodyAskedForAreShown) {
  RunReport report = passing();
  report.lookup = asked_for(0, 1);
  const std::string shown = "  not asked \"" + std::string(16, 'r') + '"';
  EXPECT_THAT(to_text(report), HasSubstr(shown + ", as the tape has it at 1.000000 s\n"));
  report.lookup->never_asked[0].size = 17;
  EXPECT_THAT(to_text(report), HasSubstr(shown + "..,"));
  report.lookup->never_asked[0].bytes = Bytes(17, 'r');
  EXPECT_THAT(to_text(report), HasSubstr(shown + "..,"));
}

TEST(ReportLines, UnderLookupThePassCountsRequests) {
  RunReport report = passing();
  report.lookup = asked_for(1, 2);
  EXPECT_THAT(to_text(report), StartsWith("pass  1 request answered, 1 of the tape's 2 different ones, to "
                                          "the driver 0 bytes, 0.000000 s\n"));
}

TEST(ReportLines, WhatWasLeftUnreadIsToldOnce) {
  RunReport report = passing();
  report.left_unread = 0;
  EXPECT_THAT(to_text(report), Not(HasSubstr("unread")));
  report.left_unread = 1;
  const std::string line = "  unread    1 byte of what was answered, when the driver closed\n";
  EXPECT_THAT(to_text(report), HasSubstr(line));
  report.unread = 1;
  EXPECT_THAT(to_text(report), Not(HasSubstr(line))) << "a doubt says it";
  report.unread.reset();
  report.timing = Timing::recorded;
  EXPECT_THAT(to_text(report), Not(HasSubstr(line))) << "a stream is left at any time";
  report.timing = Timing::reactive;
  report.diagnosis.cause = Cause{.kind = Cause::Kind::unread, .text = "bytes unread"};
  EXPECT_THAT(to_text(report), Not(HasSubstr(line))) << "the cause says it";
}

TEST(ReportLines, HowLongTheDriverTookAndWhatToTypeIsToldOfFailuresAlone) {
  RunReport report = passing();
  report.think_times = ThinkTimes{.count = 1};
  report.repeat_line = "porttape test";
  EXPECT_THAT(to_text(report), AllOf(Not(HasSubstr("latency")), Not(HasSubstr("repeat"))));
  report.verdict = Verdict::incomplete;
  EXPECT_THAT(to_text(report), AllOf(HasSubstr("  latency   "), HasSubstr("  repeat    ")));
  report.writer = Writer::device;
  EXPECT_THAT(to_text(report), Not(HasSubstr("latency")));
}

TEST(ReportLines, CutsByChanceCanBeMadeAgain) {
  RunReport report = passing();
  report.chunks = "random:7";
  EXPECT_THAT(to_text(report), HasSubstr("  chunks    cut by chance; --chunks random:7 cuts so again\n"));
  report.chunks = "bytes";
  EXPECT_THAT(to_text(report), Not(HasSubstr("chunks")));
}

TEST(ReportLines, DoubtsAreInTheFirstLineAndOneEach) {
  RunReport report = passing();
  report.doubts = {{Doubt::Kind::gap, "one"}, {Doubt::Kind::stall, "two"}};
  EXPECT_THAT(to_text(report),
              AllOf(StartsWith("pass, with doubts  "), HasSubstr("  doubt     one\n  doubt     two\n")));
}

TEST(PlaybackText, OfTheWholeTapeOnceThereIsNothingToSay) { EXPECT_EQ(to_text(PlaybackReport{}), ""); }

TEST(PlaybackText, APartIsToldByItsEnds) {
  PlaybackReport played{.start = tape_time_us(1)};
  EXPECT_EQ(to_text(played), "  played    the tape from 0.000001 s\n");
  played.preroll = true;
  EXPECT_EQ(to_text(played), "  played    the tape from 0.000001 s, the handshake before it\n");
  played = {.end = tape_time_us(2'000'000)};
  EXPECT_EQ(to_text(played), "  played    the tape from 0.000000 s to 2.000000 s\n");
}

TEST(PlaybackText, LoopsAreToldOfTheirNumber) {
  PlaybackReport played{.loops = 2, .loops_complete = 1, .loops_of = 2};
  EXPECT_EQ(to_text(played), "  played    1 of 2 loops complete\n");
  played.loops_of.reset();
  EXPECT_EQ(to_text(played), "  played    1 loop complete\n");
  played.loops_complete = 2;
  EXPECT_EQ(to_text(played), "  played    2 loops complete\n");
}

TEST(PlaybackText, WhatWasDoneByHandIsCounted) {
  PlaybackReport played{.pauses = 1, .paused = Nanos{1'500'000'999}, .steps = 2};
  EXPECT_EQ(to_text(played), "  by hand   paused once for 1.500000 s, stepped 2 times\n");
  played = {.max_gap = Micros{500'000}, .seeks = 1, .rates = 3};
  EXPECT_EQ(to_text(played),
            "  played    gaps cut to 0.500000 s\n  by hand   sought once, rate changed 3 times\n");
}

// What may have come up to now, so many bytes of a tape of 100.
RunReport undecided(std::uint64_t from) {
  RunReport report;
  report.undecided_from = from;
  return report;
}

TEST(AddTotals, WritesBehindTheRunDecideWhereItWasOpen) {
  const auto verdict = [](std::uint64_t from) {
    RunReport report = undecided(from);
    add_totals(report, {.reads = 50, .writes = 100});
    EXPECT_EQ(report.undecided_from, std::nullopt);
    return report.verdict;
  };
  EXPECT_EQ(verdict(99), Verdict::incomplete);
  EXPECT_EQ(verdict(100), Verdict::pass);
}

TEST(AddTotals, EachLoopHasWhatIsBehindTheStart) {
  RunReport report;
  report.playback.loops_of = 3;
  report.playback.prerolled = {.reads = 1, .writes = 2};
  add_totals(report, {.reads = 50, .writes = 100, .reads_before = 10, .writes_before = 30});
  EXPECT_EQ(report.to_driver_of, 1U + 3 * 40);
  EXPECT_EQ(report.from_driver_of, 2U + 3 * 70);
}

TEST(GiveUpTotals, WhatWasOpenIsIncomplete) {
  RunReport report = undecided(1);
  give_up_totals(report, "it takes too long");
  EXPECT_EQ(report.verdict, Verdict::incomplete);
  EXPECT_EQ(report.trouble, "it takes too long");
  EXPECT_EQ(report.undecided_from, std::nullopt);
  RunReport decided;
  give_up_totals(decided, "it takes too long");
  EXPECT_EQ(decided.verdict, Verdict::pass);
  EXPECT_EQ(decided.trouble, std::nullopt);
  RunReport damaged = undecided(1);
  damaged.trouble = "damaged";
  give_up_totals(damaged, "it takes too long");
  EXPECT_EQ(damaged.trouble, "damaged") << "what was told first stays";
}

}  // namespace
}  // namespace porttape
