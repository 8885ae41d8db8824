// Which kind of reason a report names, and where it says so for sure.

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/cause.hpp"
#include "libport/replay/diagnosis.hpp"
#include "libport/replay/report.hpp"
#include "tests/replay/cause_rig.hpp"

namespace porttape::test::causes {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

// "left-out", or "left-out?" where it is not sure.
std::string told(const RunReport& report) {
  if (!report.diagnosis.cause) return "nothing";
  return std::string(to_string(report.diagnosis.cause->kind)) + (report.diagnosis.cause->certain ? "" : "?");
}

std::string told(const MemoryTape& tape, const std::vector<std::string>& writes) {
  return told(after(tape, writes));
}

TEST(CauseKind, OfWholeRequests) {
  EXPECT_EQ(told(laser(), {"VV\n", "PP\n", "BM\n", "GD0044\n"}), "left-out");
  EXPECT_EQ(told(laser(), {"VV\n", "PP\n", "BM\n", "X\n"}), "left-out?");
  EXPECT_EQ(told(after(laser(), {"VV\n", "II\n"}, true)), "left-out");
  EXPECT_EQ(told(laser(), {"VV\n", "II\n", "PP\n"}), "swapped");
  EXPECT_EQ(told(laser(), {"VV\n", "II\n"}), "early?");
  EXPECT_EQ(told(laser(), {"VV\n", "PP\n", "PP\n", "II\n"}), "twice");
  EXPECT_EQ(told(laser(), {"VV\n", "PP\n", "PP\n"}), "twice?");
  EXPECT_EQ(told(laser(), {"VV\n", "PP\n", "II\n", "VV\n", "BM\n"}), "again");
  EXPECT_EQ(told(laser(), {"VV\n", "PP\n", "II\n", "VV\n", "PP\n"}), "again") << "it began again";
  EXPECT_EQ(told(laser(), {"VV\n", "PP\n", "II\n", "VV\n"}), "again?");
  EXPECT_EQ(told(laser(), {"VV\n", "HELLO\n", "PP\n"}), "unknown-request");
  EXPECT_EQ(told(laser(), {"VV\n", "HELLO\n", "II\n"}), "unknown-request");
  EXPECT_EQ(told(laser(), {"VV\n", "HELLO\n"}), "unknown-request?");
}

TEST(CauseKind, OfWhatIsWrittenBehindTheEnd) {
  const std::vector<std::string> all = {"VV\n", "PP\n", "II\n", "BM\n", "GD0044\n", "QT\n"};
  const auto told_behind = [&all](const std::vector<std::string>& more) {
    std::vector<std::string> writes = all;
    writes.insert(writes.end(), more.begin(), more.end());
    return told(laser(), writes);
  };
  EXPECT_EQ(told_behind({"RS\n"}), "at-end");
  EXPECT_EQ(told_behind({"QT\n"}), "twice");
  EXPECT_EQ(told_behind({"VV\n"}), "again");
  EXPECT_EQ(told_behind({"VV\n", "RS\n"}), "again?") << "it may have begun something else";
}

TEST(CauseKind, OfTheBytesOfARequest) {
  EXPECT_EQ(told(laser(), {"VV\n", "PPP\n"}), "byte-more");
  EXPECT_EQ(told(laser(), {"VV\n", "P\n"}), "byte-less");
  EXPECT_EQ(told(laser(), {"VV\n", "\n", "PP\n"}), "byte-more");
  EXPECT_EQ(told(laser(), {"VV\n", "PX\n"}), "changed");
  EXPECT_EQ(told(laser(), {"VV\n", "pp\n"}), "letter-case");
  EXPECT_EQ(told(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "GD0045\n"}), "off-by-one?");
  EXPECT_EQ(told(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "GD0043\n"}), "off-by-one?");
  EXPECT_EQ(told(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "GD0046\n"}), "changed");
  EXPECT_EQ(told(laser(), {"VV\n", "PP", "II\n"}), "terminator");
  EXPECT_EQ(told(laser(), {"VV\n", "PP\r\n"}), "terminator");
  EXPECT_EQ(told(modbus(), {std::string("\x01\x03\x00\x00\x00\x02\xc4\x0c", 8)}), "checksum");
}

TEST(CauseKind, OfWhatIsMissing) {
  EXPECT_EQ(told(laser(), {"VV\n", "PP"}), "terminator");
  EXPECT_EQ(told(laser(), {"VV\n", "P"}), "cut-short");
  EXPECT_EQ(told(laser(), {"VV\n", "PP\n"}), "stopped");
  EXPECT_EQ(told(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "GD0044\n"}), "left-out");
  RunReport report = after(laser(), {"VV\n", "PP\n"});
  const auto told_with = [&report](const auto& change) {
    RunReport other = report;
    change(other);
    diagnose(other);
    return told(other);
  };
  EXPECT_EQ(told_with([](RunReport& other) { other.hung = true; }), "hung?");
  EXPECT_EQ(told_with([](RunReport& other) { other.chunks = "bytes"; }), "read-sizes?");
  EXPECT_EQ(told_with([](RunReport& other) { other.delivered = 10; }), "gave-up");
  EXPECT_EQ(told_with([](RunReport& other) {
              other.delivered = 9;
              other.idle = Micros{1000};
            }),
            "gave-up?");
  report = RunReport{};
  EXPECT_EQ(told_with([](RunReport& other) {
              other.command_exit = 1;
              other.left_unread = 1;
            }),
            "unread");
}

// A driver that writes so at those times, each to be right to 10 ms.
RunReport at_times(const MemoryTape& tape, Timing timing,
                   const std::vector<std::pair<std::int64_t, std::string>>& writes) {
  ReplayConfig strict = config(2);
  strict.timing = timing;
  strict.jitter = Micros{10'000};
  Rig rig(tape, strict);
  rig.open();
  for (const auto& [us, text] : writes) rig.until(us).write(text);
  rig.finish_unless_ended();
  RunReport report = rig.report.value();
  look(report, tape);
  return report;
}

TEST(CauseKind, OfTime) {
  const auto told_at = [](std::int64_t second_at, Timing timing) {
    return told(at_times(laser(), timing, {{0, "VV\n"}, {second_at, "PP\n"}}));
  };
  EXPECT_EQ(told_at(400'000, Timing::reactive), "late");
  EXPECT_EQ(told_at(30'000, Timing::reactive), "too-soon");
  EXPECT_EQ(told_at(5'000, Timing::reactive), "not-awaited");
  EXPECT_EQ(told_at(400'000, Timing::recorded), "late");
  EXPECT_EQ(told_at(30'000, Timing::recorded), "too-soon");
}

TEST(CauseKind, ThisMachineIsBlamedForMoreThanHalfOfIt) {
  RunReport report = at_times(laser(), Timing::reactive, {{0, "VV\n"}, {400'000, "PP\n"}});
  report.mismatch->own_late = report.mismatch->error / 2;
  diagnose(report);
  EXPECT_EQ(told(report), "late");
  report.mismatch->own_late += Micros{1};
  diagnose(report);
  EXPECT_EQ(told(report), "own-lateness?");
}

std::string text_at(const MemoryTape& tape, Timing timing,
                    const std::vector<std::pair<std::int64_t, std::string>>& writes) {
  return cause(at_times(tape, timing, writes)).text;
}

TEST(CauseText, TimeIsCountedFromTheAnswerBefore) {
  EXPECT_EQ(text_at(laser(), Timing::reactive, {{0, "VV\n"}, {30'000, "PP\n"}}),
            "request 2 came too soon: 10 ms after the answer to request 1, on the tape 80 ms");
  EXPECT_EQ(text_at(laser(), Timing::reactive, {{0, "VV\n"}, {20'000, "PP\n"}}),
            "request 2 came too soon: 0 ms after the answer to request 1, on the tape 80 ms");
}

TEST(CauseText, TimeIsCountedFromTheRequestBeforeOrTheOpenWhereNothingWasAnswered) {
  const MemoryTape silent =
      MemoryTape().write(50'000, "a").read(60'000, "-").write(100'000, "b").write(200'000, "c");
  EXPECT_EQ(text_at(silent, Timing::reactive, {{0, "a"}}),
            "request 1 came too soon: 0 ms after its open, on the tape 50 ms");
  EXPECT_EQ(text_at(silent, Timing::reactive, {{50'000, "a"}, {100'000, "b"}, {300'000, "c"}}),
            "part 2 of request 2 came late: 200 ms after part 1 of request 2, on the tape 100 ms");
}

TEST(CauseText, ByTheRecordedClockItIsTheTapes) {
  EXPECT_EQ(text_at(laser(), Timing::recorded, {{0, "VV\n"}, {115'000, "PP\n"}}),
            "request 2 came late: 15 ms behind the tape's clock");
  EXPECT_EQ(text_at(laser(), Timing::recorded, {{0, "VV\n"}, {85'000, "PP\n"}}),
            "request 2 came too soon: 15 ms before the tape's clock");
}

// A driver that stopped after two of the laser's requests, with something of it changed.
std::string stopped(const std::function<void(RunReport&)>& change) {
  RunReport report = after(laser(), {"VV\n", "PP\n"});
  change(report);
  diagnose(report);
  return cause(report).text;
}

TEST(CauseText, ADriverWaitsForLongWhereItIsTenTimesTheTapesGapAndAFifthOfASecond) {
  const auto waits = [](std::int64_t idle_us) {
    return stopped([idle_us](RunReport& report) {
             report.idle = Micros{idle_us};
           }).find("looks like it waited") != std::string::npos;
  };
  EXPECT_FALSE(waits(799'999));
  EXPECT_TRUE(waits(800'000)) << "the tape's driver took 80 ms";
  MemoryTape quick = MemoryTape().write(0, "a\n").read(1000, "x").write(2000, "b\n").read(3000, "y");
  quick.write(4000, "c\n");
  RunReport report = after(quick, {"a\n"});
  report.idle = Micros{199'999};
  diagnose(report);
  EXPECT_THAT(cause(report).text, StartsWith("the driver stopped after "));
  report.idle = Micros{200'000};
  diagnose(report);
  EXPECT_THAT(cause(report).text, StartsWith("the driver stopped 200 ms after "));
}

TEST(CauseText, SoonIsTwentyMillisecondsAtLeast) {
  MemoryTape quick = MemoryTape().write(0, "a\n").read(1000, "x").write(2000, "b\n").read(3000, "y");
  const auto gave_up = [&quick](std::int64_t us) {
    Rig rig(quick, config());
    rig.open().blocked(true).write("a\n").wait(us).close();
    RunReport report = rig.report.value();
    look(report, quick);
    return cause(report);
  };
  EXPECT_FALSE(gave_up(19'999).certain);
  EXPECT_TRUE(gave_up(20'000).certain);
}

TEST(CauseText, BytesThatWereLeftUnreadAreTheReasonForSure) {
  EXPECT_EQ(stopped([](RunReport& report) {
              report.left_unread = 1;
              report.idle = Micros{2'000'000};
            }),
            "the driver stopped after the answer to request 2, which came in full (9 bytes) and left 1 of 9 "
            "bytes unread: request 3 \"II\\n\" never came");
  EXPECT_THAT(stopped([](RunReport& report) { report.left_unread = 0; }), Not(HasSubstr("unread")));
}

TEST(CauseText, ALastRequestIsNotCalledLeftOutWhereTheCommandFailed) {
  RunReport report = after(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "GD0044\n"});
  report.command_exit = 0;
  diagnose(report);
  EXPECT_EQ(told(report), "left-out");
  report.command_exit = 1;
  diagnose(report);
  EXPECT_EQ(told(report), "stopped");
}

TEST(CauseText, ADriverThatWritesNothingStoppedBeforeItsFirstRequest) {
  RunReport report = after(laser(), {});
  EXPECT_EQ(cause(report).text,
            "the driver stopped before its first request: request 1 \"VV\\n\" never came");
  EXPECT_EQ(told(report), "stopped");
  report.hung = true;
  report.playback.loops = 2;
  diagnose(report);
  EXPECT_EQ(cause(report).text,
            "the driver hung before the first request of loop 2: request 1 \"VV\\n\" never came");
  EXPECT_EQ(told(report), "hung");
}

TEST(CauseText, ARequestThatNobodyAnsweredIsWhatItStoppedAfter) {
  const MemoryTape tape = MemoryTape().write(0, "a").write(50'000, "b").read(60'000, "-");
  EXPECT_EQ(cause(after(tape, {"a"})).text,
            "the driver stopped after part 1 of request 1: part 2 of request 1 \"b\" never came");
}

TEST(CauseText, WhatIsCutShortSaysWhatIsMissing) {
  EXPECT_EQ(
      text(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "GD0"}),
      "request 5 cut short: four bytes less, the last: the tape has \"044\\n\" (30 34 34 0a) at byte 3, "
      "without which the tape does not go on");
  const MemoryTape tape = MemoryTape().write(0, "ab");
  EXPECT_EQ(text(tape, {"a"}),
            "request 1 cut short: one byte less, the last: the tape has \"b\" (62) at byte 1");
}

TEST(CauseText, TheBeginningOfALaterRequestMayBeThat) {
  EXPECT_EQ(text(laser(), {"VV\n", "GD00"}),
            "looks like request 2 to 4 left out, or swapped with request 5, whose beginning came instead");
  EXPECT_EQ(told(laser(), {"VV\n", "GD00"}), "early?");
  EXPECT_NE(told(laser(), {"VV\n", "G"}), "early?") << "one byte is too little";
}

TEST(CauseText, WhatTheAnswerBeforeHasToDoWithItIsToldWhereItHadNotCome) {
  const RunReport report = after(laser(), {"VV\n", "II\n", "PP\n"});
  EXPECT_THAT(cause(report).text, Not(HasSubstr("had come")));
  RunReport early = report;
  early.mismatch->delivered = 8;
  diagnose(early);
  EXPECT_THAT(cause(early).text, EndsWith(", before the answer to request 1 had come (8 of 9 bytes)"));
  early.lookup.emplace();
  diagnose(early);
  EXPECT_THAT(cause(early).text, Not(HasSubstr("had come"))) << "under lookup it has no place";
}

TEST(CauseText, CutsAreNoReasonForTheTimeNorWhereNothingCame) {
  RunReport report = at_times(laser(), Timing::reactive, {{0, "VV\n"}, {400'000, "PP\n"}});
  report.chunks = "bytes";
  diagnose(report);
  EXPECT_EQ(told(report), "late");
  report = after(laser(), {"VV\n"});
  report.chunks = "bytes";
  report.delivered = 0;
  diagnose(report);
  EXPECT_NE(told(report), "read-sizes?");
  report.delivered = 1;
  diagnose(report);
  EXPECT_EQ(told(report), "read-sizes?");
}

TEST(CauseText, ARunThatPassedHasACauseOnlyWhereTheCommandFailedAndLeftBytes) {
  RunReport report;
  report.left_unread = 1;
  diagnose(report);
  EXPECT_EQ(told(report), "nothing");
  report.command_exit = 1;
  diagnose(report);
  EXPECT_EQ(told(report), "unread");
  report.left_unread = 0;
  diagnose(report);
  EXPECT_EQ(told(report), "nothing");
}

}  // namespace
}  // namespace porttape::test::causes
