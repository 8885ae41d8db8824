// What a report says of the reason: from what the tape has and what came.

#include "libport/replay/cause.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/diagnosis.hpp"
#include "libport/replay/report.hpp"
#include "tests/replay/cause_rig.hpp"

namespace porttape::test::causes {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::StartsWith;

TEST(CauseOfData, ARequestThatIsLeftOut) {
  const Cause found = cause(after(laser(), {"VV\n", "PP\n", "BM\n", "GD0044\n"}));
  EXPECT_EQ(found.text, "request 3 left out: request 4 came instead");
  EXPECT_EQ(found.kind, Cause::Kind::left_out);
  EXPECT_TRUE(found.certain);
  EXPECT_EQ(found.request, 3U);
  EXPECT_EQ(text(laser(), {"VV\n", "GD0044\n", "QT\n"}), "request 2 to 4 left out: request 5 came instead");
}

TEST(CauseOfData, WhatPrecedesAPartIsNoneOfIt) {
  MemoryTape tape = laser();
  ReplayConfig part = config();
  part.start = TapeTime{Micros{kPace}};
  Rig rig(tape, part);
  rig.open().write("VV\n").wait(kPace);
  RunReport report = rig.report.value();
  MemorySource source(tape);
  TapeExcerpt excerpt = read_excerpt(source, *place_of_fault(report), kFrameGap).value();
  begin_at(excerpt, report.playback.start);
  EXPECT_EQ(excerpt.place, 0U);
  EXPECT_EQ(excerpt.steps.front().frame.exchange, 2U);
  report.excerpt = std::make_shared<const TapeExcerpt>(std::move(excerpt));
  diagnose(report);
  EXPECT_THAT(cause(report).text, testing::Not(HasSubstr("twice")));
}

TEST(CauseOfData, TwoThatAreSwapped) {
  const Cause found = cause(after(laser(), {"VV\n", "II\n", "PP\n"}));
  EXPECT_EQ(found.text, "exchanges 2 and 3 swapped: request 3 came first");
  EXPECT_TRUE(found.certain);
  EXPECT_EQ(text(laser(), {"VV\n", "BM\n", "PP\n"}), "wrong order: request 4 came before request 2");
}

TEST(CauseOfData, WhatIsNotKnownIsNotSaidAsIfItWere) {
  const Cause found = cause(after(laser(), {"VV\n", "II\n"}));
  EXPECT_EQ(found.text, "looks like request 2 left out, or swapped with request 3, which came instead");
  EXPECT_FALSE(found.certain);
  EXPECT_EQ(cause(after(laser(), {"VV\n", "II\n"}, true)).text, "request 2 left out: request 3 came instead")
      << "it was answered, and wrote nothing more";
}

TEST(CauseOfData, OneThatIsSentTwice) {
  EXPECT_EQ(text(laser(), {"VV\n", "PP\n", "PP\n", "II\n"}), "request 2 sent twice before request 3");
  EXPECT_EQ(text(laser(), {"VV\n", "PP\n", "II\n", "VV\n", "BM\n"}), "request 1 sent again before request 4");
  EXPECT_EQ(text(laser(), {"VV\n", "PP\n", "II\n", "VV\n", "PP\n"}),
            "it began again with request 1 instead of going on");
  EXPECT_EQ(text(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "GD0044\n", "QT\n", "QT\n"}),
            "request 6, the last, sent twice");
}

TEST(CauseOfData, ItMayBeginAgainInTheMiddle) {
  EXPECT_EQ(text(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "PP\n", "II\n"}),
            "it began again with request 2 instead of going on");
  EXPECT_EQ(text(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "PP\n", "VV\n"}),
            "looks like request 2 sent again before request 5");
  EXPECT_EQ(text(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "GD0044\n", "QT\n", "PP\n"}),
            "request 2 sent again");
}

TEST(CauseOfData, TheTapesLastRequestMayComeTooEarly) {
  EXPECT_EQ(text(laser(), {"VV\n", "PP\n", "QT\n", "II\n"}), "wrong order: request 6 came before request 3");
  EXPECT_EQ(text(laser(), {"VV\n", "PP\n", "QT\n"}),
            "looks like request 3 to 5 left out, or swapped with request 6, which came instead");
}

TEST(CauseOfData, OneThatIsSentTwiceBeforeItsAnswerCame) {
  Rig rig(laser(), config());
  rig.open().write("VV\n").wait(5'000).write("VV\n");
  RunReport report = rig.report.value();
  look(report, laser());
  EXPECT_EQ(
      cause(report).text,
      "looks like request 1 sent twice before request 2, before the answer to request 1 had come (0 of 9 "
      "bytes)");
}

TEST(CauseOfData, AmongPollsThatLookAlikeBothReasonsAreTold) {
  const MemoryTape polls = tape_of({"P\n", "Q\n", "P\n", "Q\n"});
  EXPECT_EQ(text(polls, {"P\n", "P\n"}),
            "looks like request 2 left out, or swapped with request 3, which came instead; or request 1 sent "
            "twice before request 2");
}

TEST(CauseOfData, BytesMoreAndLess) {
  EXPECT_EQ(text(laser(), {"VV\n", "PPP\n"}), "one byte more in request 2: \"P\" (50) at byte 2");
  EXPECT_EQ(text(laser(), {"VV\n", "P\n"}), "one byte less in request 2: the tape has \"P\" (50) at byte 1");
  EXPECT_EQ(text(laser(), {"VV\n", "\n", "PP\n"}), "one byte more before request 2: \"\\n\" (0a)");
  EXPECT_EQ(text(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "GD4\n"}),
            "three bytes less in request 5: the tape has \"004\" (30 30 34) at byte 2");
}

TEST(CauseOfData, OtherBytes) {
  EXPECT_EQ(text(laser(), {"VV\n", "PX\n"}),
            "one byte of request 2 is another: \"X\" (58) where the tape has \"P\" (50), at byte 1");
  EXPECT_EQ(
      text(laser(), {"VV\n", "pp\n"}),
      "another case of letters in request 2: \"pp\" (70 70) where the tape has \"PP\" (50 50), at byte 0");
  EXPECT_EQ(text(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "GD0045\n"}),
            "looks like an off-by-one in request 5: 45 where the tape has 44, at byte 5");
}

TEST(CauseOfData, ALengthThatIsOneOff) {
  const MemoryTape frames = tape_of({"A\n", "\x05hello", "B\n"});
  EXPECT_EQ(text(frames, {"A\n", "\x06hello"}),
            "looks like an off-by-one length in request 2: 06 where the tape has 05, at byte 0");
  EXPECT_EQ(text(frames, {"A\n", "\x04hello"}),
            "looks like an off-by-one length in request 2: 04 where the tape has 05, at byte 0");
  EXPECT_EQ(text(frames, {"A\n", "\x07hello"}),
            "one byte of request 2 is another: 07 where the tape has 05, at byte 0");
}

TEST(CauseOfData, TheLineEnd) {
  EXPECT_EQ(text(laser(), {"VV\n", "PP", "II\n"}),
            "terminator missing: request 2 came without its \"\\n\" (0a), and the next one right behind it");
  EXPECT_EQ(text(laser(), {"VV\n", "PP\r"}),
            "another terminator: request 2 ends with \"\\r\" (0d) where the tape has \"\\n\" (0a)");
  EXPECT_EQ(text(laser(), {"VV\n", "PP\r\n"}),
            "another terminator: request 2 ends with \"\\r\\n\" (0d 0a) where the tape has \"\\n\" (0a)");
}

TEST(CauseOfData, ARequestThatTheTapeDoesNotHave) {
  EXPECT_EQ(text(laser(), {"VV\n", "HELLO\n", "PP\n"}),
            "one request more before request 2: \"HELLO\\n\", which the tape does not have there");
  EXPECT_EQ(text(laser(), {"VV\n", "HELLO\n", "II\n"}),
            "another request than request 2: \"HELLO\\n\", which the tape does not have near it");
  EXPECT_EQ(text(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "GD0044\n", "QT\n", "RS\n"}),
            "one write more at the end: \"RS\\n\", where the tape has nothing more");
  EXPECT_EQ(text(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "GD0044\n", "QT\n", "\n"}),
            "1 byte more at the end: \"\\n\", where the tape has nothing more");
}

TEST(CauseOfData, AChecksumIsToldFromItsBytes) {
  EXPECT_EQ(text(modbus(), {std::string("\x01\x03\x00\x00\x00\x02\xc4\x0c", 8)}),
            "wrong checksum in request 1: c4 0c, where the CRC-16/MODBUS of its bytes is c4 0b");
  EXPECT_EQ(text(modbus(), {std::string("\x01\x03\x00\x00\x00\x05\x85\xc9", 8)}),
            "one byte of request 1 is another: 05 where the tape has 02, at byte 5")
      << "its checksum is right for what it is";
}

TEST(CauseOfData, BinaryRequestsAreFoundWithoutLines) {
  const std::string second("\x01\x03\x00\x10\x00\x01\x85\xcf", 8);
  const std::string third("\x01\x06\x00\x01\x00\x17\x98\x04", 8);
  EXPECT_EQ(text(modbus(), {second, third}), "request 1 left out: request 2 came instead");
  EXPECT_EQ(text(modbus(), {std::string("\x01\x03\x00\x00\x00\xc4\x0b", 7) + second}),
            "one byte less in request 1: the tape has 02 at byte 5");
}

TEST(CauseOfMissing, ARequestThatIsCutShort) {
  EXPECT_EQ(
      text(laser(), {"VV\n", "PP"}),
      "terminator missing: request 2 came without its \"\\n\" (0a), without which the tape does not go on");
  EXPECT_THAT(text(laser(), {"VV\n", "P"}),
              StartsWith("request 2 cut short: two bytes less, the last: the tape has"));
}

TEST(CauseOfMissing, ADriverThatStops) {
  EXPECT_EQ(text(laser(), {"VV\n", "PP\n"}),
            "the driver stopped after the answer to request 2, which came in full (9 bytes): request 3 "
            "\"II\\n\" never "
            "came");
  EXPECT_EQ(
      text(laser(), {"VV\n", "PP\n", "II\n", "BM\n", "GD0044\n"}),
      "request 6, the last, left out: it ended after the answer to request 5, which came in full (9 bytes)");
}

TEST(CauseOfMissing, ADriverThatHangs) {
  RunReport report = after(laser(), {"VV\n", "PP\n"});
  report.hung = true;
  diagnose(report);
  EXPECT_EQ(
      cause(report).text,
      "the driver hung after the answer to request 2, which came in full (9 bytes): looks like it waits for "
      "more than that; request 3 \"II\\n\" never came");
}

TEST(CauseOfMissing, ADriverThatDoesNotWaitForItsAnswer) {
  Rig rig(laser(), config());
  rig.open().write("VV\n").wait(kPace).write("PP\n").wait(5'000).close();
  RunReport report = rig.report.value();
  look(report, laser());
  EXPECT_EQ(cause(report).text,
            "the driver gave up 5 ms after request 2, before the answer to request 2 had come (0 of 9 "
            "bytes): looks "
            "like it took unread bytes of an answer before for it, or did not wait; request 3 \"II\\n\" "
            "never came");
}

// A machine that is busy makes it slower, and the tape's driver had waited for longer.
TEST(CauseOfMissing, SoonIsWhatTheTapesDriverWaitedForUpToALimit) {
  const auto text = [](std::int64_t answered_us, std::int64_t gave_up_us) {
    MemoryTape tape;
    tape.open(0)
        .write(0, "VV\n")
        .read(1'000, "ok\n")
        .write(kPace, "PP\n")
        .read(kPace + answered_us, "version\n");
    tape.write(kPace * 10, "II\n").read(kPace * 10 + 1'000, "state\n");
    Rig rig(tape, config());
    rig.open().write("VV\n").wait(kPace).write("PP\n").wait(gave_up_us).close();
    RunReport report = rig.report.value();
    look(report, tape);
    return cause(report).text;
  };
  const auto soon = HasSubstr("looks like it took unread bytes of an answer before");
  EXPECT_THAT(text(62'000, 23'000), soon);
  EXPECT_THAT(text(62'000, 61'000), soon);
  EXPECT_THAT(text(500'000, 99'999), soon);
  EXPECT_THAT(text(500'000, 100'000), StartsWith("the driver gave up 100 ms after the last byte"));
}

TEST(CauseOfMissing, ADriverThatRunsOutOfPatience) {
  RunReport report = after(laser(), {"VV\n", "PP\n"});
  report.idle = Micros{2'000'000};
  diagnose(report);
  EXPECT_THAT(cause(report).text,
              StartsWith("the driver stopped 2000 ms after the answer to request 2, which came in "
                         "full (9 bytes): looks like it waited for more than that; request 3"));
  report.delivered = 10;
  diagnose(report);
  EXPECT_THAT(cause(report).text,
              StartsWith("the driver gave up 2000 ms after the last byte, before the answer to "
                         "request 2 had come (1 of 9 bytes): request 3"));
}

TEST(CauseOfMissing, UnreadBytesAndTheStatusOfTheCommandArePartOfIt) {
  RunReport report = after(laser(), {"VV\n", "PP\n"});
  report.command_exit = 1;
  report.left_unread = 4;
  diagnose(report);
  EXPECT_THAT(cause(report).text,
              HasSubstr("which came in full (9 bytes) and left 4 of 9 bytes unread: request 3"));
  RunReport passed;
  passed.command_exit = 1;
  passed.left_unread = 3;
  diagnose(passed);
  EXPECT_EQ(cause(passed).text,
            "bytes unread: the driver closed with 3 bytes of what it was answered unread");
}

TEST(CauseOfMissing, WhereReadsWereCutThatMayBeTheReason) {
  RunReport report = after(laser(), {"VV\n", "PP\n"});
  report.chunks = "bytes";
  diagnose(report);
  EXPECT_THAT(cause(report).text, AllOf(StartsWith("looks like a parser that depends on read sizes"),
                                        HasSubstr("the driver stopped after the answer to request 2")));
}

RunReport timed(std::int64_t second_at) {
  Rig rig(laser(), config(2));
  rig.open().write("VV\n").until(second_at).write("PP\n").wait(kPace);
  RunReport report = rig.finish() == Verdict::pass ? RunReport{} : rig.report.value();
  look(report, laser());
  return report;
}

TEST(CauseOfTiming, ALateRequestIsToldFromTheAnswerBefore) {
  EXPECT_EQ(cause(timed(400'000)).text,
            "request 2 came late: 380 ms after the answer to request 1, on the tape 80 ms");
}

TEST(CauseOfTiming, ARequestThatDidNotWaitForTheAnswer) {
  MemoryTape tape =
      MemoryTape().write(0, "VV\n").read(300'000, "ok\n").write(310'000, "PP\n").read(320'000, "ok\n");
  Rig rig(tape, config(2));
  rig.open().write("VV\n").until(50'000).write("PP\n").wait(1'000'000);
  RunReport report = rig.report.value();
  look(report, tape);
  EXPECT_EQ(
      cause(report).text,
      "request 2 did not wait for the answer to request 1: it came 250 ms before the last of its 3 bytes, on "
      "the tape 10 ms after it");
}

TEST(CauseOfTiming, OwnLatenessIsNotTheDrivers) {
  RunReport report = timed(400'000);
  report.mismatch->own_late = Micros{290'000};
  diagnose(report);
  EXPECT_THAT(cause(report).text, StartsWith("looks like this machine, not the driver: "));
}

TEST(CauseOfData, WithRulesOfWhatMayVaryOnlyWholeFramesTell) {
  RunReport report = after(laser(), {"VV\n", "PX\n"});
  report.ruled = true;
  diagnose(report);
  EXPECT_FALSE(report.diagnosis.cause.has_value());
  report = after(laser(), {"VV\n", "II\n", "PP\n"});
  report.ruled = true;
  diagnose(report);
  EXPECT_EQ(cause(report).kind, Cause::Kind::swapped);
}

TEST(CauseOfData, TheDevicesWordsAreItsOwn) {
  RunReport report = after(laser(), {"VV\n", "PP\n", "BM\n", "GD0044\n"});
  report.writer = Writer::device;
  diagnose(report);
  EXPECT_EQ(cause(report).text, "answer 3 left out: answer 4 came instead");
}

TEST(Excerpt, StaysBoundedAndKnowsItsPlace) {
  MemoryTape tape;
  for (std::int64_t i = 0; i < 1000; ++i)
    tape.write(i * 1000, "x" + std::to_string(100 + i % 900) + "\n").read(i * 1000 + 500, "y");
  MemorySource source(tape);
  const TapeExcerpt excerpt = read_excerpt(source, 5 * 500 + 2, kFrameGap).value();
  EXPECT_LE(excerpt.steps.size(), 2 * TapeExcerpt::kReach + 2);
  EXPECT_EQ(excerpt.steps.at(excerpt.place).frame.exchange, 501U);
  EXPECT_FALSE(excerpt.from_start);
  EXPECT_FALSE(excerpt.to_end);
  MemorySource again(tape);
  EXPECT_EQ(read_excerpt(again, 999'999, kFrameGap)->place, TapeExcerpt::kReach);
  MemorySource stopped(tape);
  EXPECT_FALSE(read_excerpt(stopped, 999'999, kFrameGap, [] { return true; }) &&
               stopped.calls() > 2 * kRecordsBetweenLooks);
}

}  // namespace
}  // namespace porttape::test::causes
