// What a report says.

#include "libport/replay/report.hpp"

#include <array>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/error.hpp"
#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using test::bytes_of;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

RunReport passed() {
  RunReport report;
  report.tape = "laser.log";
  report.rate = 2.5;
  report.duration = std::chrono::microseconds{1'250'000};
  report.to_driver_bytes = 3222;
  report.to_driver_of = 3222;
  report.from_driver_bytes = report.from_driver_matched = 42;
  report.from_driver_of = 42;
  report.timer_late_p50_us = 12.5;
  report.timer_late_p99_us = 80;
  report.timer_late_max_us = 131;
  return report;
}

RunReport mismatched() {
  RunReport report = passed();
  report.verdict = Verdict::data_mismatch;
  report.from_driver_matched = 12;
  report.mismatches = 1;
  Mismatch mismatch;
  mismatch.offset = 12;
  mismatch.tape = tape_time_us(1'234'567);
  mismatch.real = Micros{2'000'001};
  mismatch.expected = bytes_of("BM\n");
  mismatch.got = bytes_of("\x01QT\n");
  mismatch.before = bytes_of("VV\n");
  mismatch.exchange = 3;
  mismatch.tape_offset = 12;
  mismatch.hint = "comes later at offset 40 (tape 0.900000 s)";
  report.mismatch = mismatch;
  return report;
}

TEST(ReportJson, HoldsTheKeysOfTheContractInOrder) {
  EXPECT_EQ(
      to_json(passed()),
      R"({"verdict":"pass","exit":0,"tape":"laser.log","strictness":1,"timing":"reactive","rate":2.5,)"
      R"("duration_s":1.25,"to_driver":{"bytes":3222,"of":3222},)"
      R"("from_driver":{"bytes":42,"matched":42,"of":42},"mismatch":null,)"
      R"("timer_late_us":{"p50":12.5,"p99":80,"max":131},"command_exit":null,)"
      R"("mismatches":0,"doubts":[],"next_expected":null,)"
      R"("sessions":{"made":1,"of":1},"session":null,"missed_half_close_us":null,)"
      R"("settings":{"recorded":0,"made":0,"missing":[],"checked":false},"told":{},)"
      R"("playback":{"start_s":0,"end_s":null,"preroll":false,"max_gap_s":null,"loops":1,"loops_complete":0,)"
      R"("loops_of":1,"pauses":0,"paused_s":0,"steps":0,"seeks":0,"rates":0},"writer":"driver",)"
      R"("cause":null,"diff":[],"previous":null,"next":null,"latency_us":null,"left_unread":null,"unread":null,"idle_us":0,)"
      R"("closed":false,)"
      R"("outcome":"","command_end":"","commands":null,"faults":null})"
      "\n");
}

TEST(ReportJson, HoldsTheMismatch) {
  EXPECT_THAT(to_json(mismatched()),
              HasSubstr(R"("mismatch":{"kind":"data","offset":12,"tape_us":1234567,"real_us":2000001,)"
                        R"("expected_hex":"424d0a","got_hex":"0151540a","error_us":0,)"
                        R"j("hint":"comes later at offset 40 (tape 0.900000 s)","before_hex":"56560a",)j"
                        R"("exchange":3,"tape_offset":12,"own_late_us":0,"rule":"","came_hex":"","write":0,)"
                        R"("write_offset":0,"allowed_us":0})"));
}

TEST(ReportJson, OddNamesStayValidJson) {
  RunReport report = passed();
  report.tape = "a\"b\\c\n\x01\x7f\xff\xc3\xa9";
  report.trouble = "block \xed\xa0\x80 \"x\"";
  const std::string json = to_json(report);
  EXPECT_THAT(json, HasSubstr("\"tape\":\"a\\\"b\\\\c\\n\\u0001"));
  EXPECT_THAT(json, HasSubstr("\xc3\xa9\""));
  EXPECT_THAT(json, Not(HasSubstr("\xff")));
  EXPECT_THAT(json, Not(HasSubstr("\xed\xa0\x80")));
  EXPECT_THAT(json, HasSubstr("\\\"x\\\"\"}\n"));
}

TEST(ReportJson, NumbersJsonHasNot) {
  RunReport report = passed();
  report.rate = std::numeric_limits<double>::infinity();
  report.timer_late_max_us = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(to_json(report), HasSubstr("\"rate\":0,"));
  EXPECT_THAT(to_json(report), HasSubstr("\"max\":0}"));
}

TEST(ReportJson, CommandExitTroubleAndWhatIsMissing) {
  RunReport report = passed();
  report.verdict = Verdict::incomplete;
  report.command_exit = -3;
  report.next_expected = bytes_of("QT");
  report.next_expected_offset = 40;
  report.next_expected_tape = tape_time_us(7);
  EXPECT_THAT(
      to_json(report),
      HasSubstr(
          R"("command_exit":-3,"mismatches":0,"doubts":[],"next_expected":{"offset":40,"tape_us":7,"hex":"5154"},)"));
}

TEST(ExitStatus, FollowsTheContract) {
  RunReport report = passed();
  EXPECT_EQ(exit_status_of(report), 0);
  report.command_exit = 7;
  EXPECT_EQ(exit_status_of(report), 1);
  report.verdict = Verdict::data_mismatch;
  EXPECT_EQ(exit_status_of(report), 3);
  report.verdict = Verdict::extra;
  EXPECT_EQ(exit_status_of(report), 3);
  report.verdict = Verdict::timing_mismatch;
  EXPECT_EQ(exit_status_of(report), 4);
  report.verdict = Verdict::incomplete;
  EXPECT_EQ(exit_status_of(report), 5);
  report.trouble = "disk";
  EXPECT_EQ(exit_status_of(report), 1);
}

TEST(Damage, NothingPassesByIt) {
  RunReport report = passed();
  report.undecided_from = 7;
  damage(report, "changed");
  EXPECT_EQ(report.verdict, Verdict::incomplete);
  EXPECT_EQ(report.undecided_from, std::nullopt);
  EXPECT_EQ(exit_status_of(report), 1);
  report = mismatched();
  damage(report, "changed");
  EXPECT_EQ(report.verdict, Verdict::data_mismatch);
  EXPECT_EQ(report.trouble, "changed");
}

TEST(ReportText, PassIsOneLine) {
  EXPECT_EQ(to_text(passed()),
            "pass  laser.log: from the driver 42 of 42 bytes as recorded, to the driver 3222 of 3222, "
            "1.250000 s\n");
}

// The driver's third write was "VX\n"; the tape has "VV\n", "BM\n".
Mismatch wrong_byte() {
  Mismatch mismatch;
  mismatch.offset = mismatch.tape_offset = 17;
  mismatch.tape = tape_time_us(1'234'567);
  mismatch.real = Micros{2'000'001};
  mismatch.expected = bytes_of("V\nBM\n");
  mismatch.got = bytes_of("X\nBM\n");
  mismatch.before = bytes_of("QT\nV");
  mismatch.block_before = 1;
  mismatch.block_after = 2;
  mismatch.write = 3;
  mismatch.write_offset = 1;
  mismatch.exchange = 3;
  return mismatch;
}

TEST(ReportText, TheCauseStandsFirstAndTheMarkUnderItsByte) {
  RunReport report = mismatched();
  report.mismatch = wrong_byte();
  report.mismatch->hint = "comes later at offset 40 (tape 0.900000 s)";
  EXPECT_EQ(
      to_text(report),
      "data mismatch: the driver wrote \"VX\\n\" where the tape has \"VV\\n\"\n"
      "  at byte 1 of its write no. 3 (byte 17 of all it wrote, 2.000001 s after its open; tape time "
      "1.234567 s, exchange 3)\n"
      "  expected  51 54 0a 56 56 0a 42 4d 0a  \"QT\\nVV\\nBM\\n\"\n"
      "  got       51 54 0a 56 58 0a 42 4d 0a  \"QT\\nVX\\nBM\\n\"\n"
      "                        ^^\n"
      "  hint      comes later at offset 40 (tape 0.900000 s)\n"
      "  laser.log: from the driver 12 of 42 bytes as recorded, to the driver 3222 of 3222, 1.250000 s\n");
}

TEST(ReportText, BytesThatAreNoTextAreShownInHex) {
  Mismatch mismatch = wrong_byte();
  mismatch.before = {0x01, 0x04};
  mismatch.block_before = 2;
  mismatch.expected = {0x00, 0x02, 0x71, 0xcb};
  mismatch.block_after = 4;
  mismatch.got = {0x00, 0x03, 0xb0, 0x0b};
  EXPECT_THAT(
      to_text(mismatch),
      HasSubstr("data mismatch: the driver wrote 01 04 00 03 b0 0b where the tape has 01 04 00 02 71 cb\n"));
}

TEST(ReportText, WhereNoWriteIsKnownTheStreamCounts) {
  Mismatch mismatch = wrong_byte();
  mismatch.write = 0;
  mismatch.tape_offset = 20;
  EXPECT_THAT(
      to_text(mismatch),
      HasSubstr("  at byte 17 of all it wrote (2.000001 s after its open; tape time 1.234567 s, exchange 3, "
                "byte 20 of its writes)\n"));
}

TEST(ReportText, LongBytesAreCut) {
  RunReport report = mismatched();
  report.mismatch->before = Bytes(32, 'b');
  report.mismatch->block_before = 100;
  report.mismatch->expected = Bytes(32, 'e');
  report.mismatch->block_after = 200;
  report.mismatch->got = Bytes(1, 'g');
  EXPECT_THAT(
      to_text(report),
      HasSubstr("  expected  62 62 62 62 62 62 62 62 65 65 65 65 65 65 65 65 65 65 65 65 65 65 65 65 ..  "
                "\"bbbbbbbbeeeeeeeeeeeeeeee\"..\n"));
  EXPECT_THAT(to_text(report), HasSubstr("where the tape has ..\"bbbbbbbbbbbbbbbbeeeeeeeeeeeeeeee\"..\n"));
}

TEST(ReportText, TimingTellsTheWriteTheErrorAndOurOwnLateness) {
  RunReport report = mismatched();
  report.verdict = Verdict::timing_mismatch;
  report.mismatch = wrong_byte();
  report.mismatch->kind = MismatchKind::timing;
  report.mismatch->write = 0;
  report.mismatch->expected = report.mismatch->got = bytes_of("GD0044072501\n");
  report.mismatch->error = Micros{213'200};
  report.mismatch->allowed = Micros{200'000};
  report.mismatch->own_late = Micros{70};
  EXPECT_EQ(
      to_text(report),
      "timing mismatch: \"GD0044072501\\n\" came 213.2 ms later than recorded (200 ms allowed)\n"
      "  at byte 17 of all it wrote (2.000001 s after its open; tape time 1.234567 s, exchange 3)\n"
      "  our own delivery before it was 0.07 ms late\n"
      "  laser.log: from the driver 12 of 42 bytes as recorded, to the driver 3222 of 3222, 1.250000 s\n"
      "  our own timers were late by 12.5 us (median), 80.0 us (99 %), 131.0 us (most)\n");
  report.mismatch->error = -report.mismatch->error;
  EXPECT_THAT(to_text(report), HasSubstr(" came 213.2 ms earlier than recorded "));
}

TEST(ReportText, IncompleteTellsWhatIsMissing) {
  RunReport report = passed();
  report.verdict = Verdict::incomplete;
  report.from_driver_matched = 36;
  report.next_expected = bytes_of("QT\nRS\n");
  report.next_expected_block = 3;
  report.next_expected_offset = 36;
  report.next_expected_tape = tape_time_us(900'000);
  EXPECT_EQ(
      to_text(report),
      "incomplete: the driver never wrote \"QT\\n\"\n"
      "  the tape has it at 0.900000 s, byte 36 of the driver's writes: 51 54 0a\n"
      "  6 recorded bytes never came from the driver\n"
      "  laser.log: from the driver 36 of 42 bytes as recorded, to the driver 3222 of 3222, 1.250000 s\n");
  report.next_expected_before = bytes_of("as");
  report.next_expected = bytes_of("k\n");
  report.next_expected_block = 2;
  EXPECT_THAT(to_text(report), HasSubstr("incomplete: the driver wrote \"as\" of \"ask\\n\"\n"));
}

TEST(ReportText, ATimingMismatchBeforeWhatIsMissingIsToldToo) {
  RunReport report = passed();
  report.verdict = Verdict::incomplete;
  report.next_expected = bytes_of("QT\n");
  report.next_expected_block = 3;
  report.mismatch = wrong_byte();
  report.mismatch->kind = MismatchKind::timing;
  const std::string text = to_text(report);
  EXPECT_THAT(text, testing::StartsWith("incomplete: the driver never wrote \"QT\\n\"\n"));
  EXPECT_THAT(text, HasSubstr("  before    \"X\\nBM\\n\" came 0 ms earlier than recorded (0 ms allowed)\n"));
}

TEST(ReportText, TroubleCommandAndMoreMismatchesAreTold) {
  RunReport report = mismatched();
  report.mismatches = 5;
  report.trouble = "laser.logr: block at byte 12 is damaged";
  report.command_end = "ended with status 9";
  const std::string text = to_text(report);
  EXPECT_THAT(text, testing::StartsWith(
                        "failed: the tape could not be read on: laser.logr: block at byte 12 is damaged\n"));
  EXPECT_THAT(text, HasSubstr("  mismatches in all: 5\n"));
  EXPECT_THAT(text, HasSubstr("  the command ended with status 9\n"));
}

TEST(ReportText, AnOutcomeOfTheProgramsStandsFirst) {
  RunReport report = passed();
  report.outcome = "failed: the driver did all as recorded, but the command ended with status 1";
  EXPECT_EQ(to_text(report, true), "\033[31m" + report.outcome +
                                       "\033[0m\n"
                                       "  laser.log: from the driver 42 of 42 bytes as recorded, to the "
                                       "driver 3222 of 3222, 1.250000 s\n");
  report = mismatched();
  report.mismatch = wrong_byte();
  report.outcome = "interrupted by SIGINT (2)";
  EXPECT_THAT(to_text(report),
              testing::StartsWith("interrupted by SIGINT (2)\n"
                                  "  verdict   data mismatch: the driver wrote \"VX\\n\" where the tape has "
                                  "\"VV\\n\"\n  at byte 1 of its write no. 3 ("));
}

TEST(ReportText, ExtraSaysThatTheTapeHasNoMore) {
  Mismatch mismatch;
  mismatch.kind = MismatchKind::extra;
  mismatch.got = bytes_of("x");
  mismatch.write = 1;
  EXPECT_EQ(to_text(mismatch),
            "extra: the driver wrote \"x\" where the tape has nothing more\n"
            "  at byte 0 of its write no. 1 (byte 0 of all it wrote, 0.000000 s after its open; tape time "
            "0.000000 s, exchange 0)\n"
            "  expected  --  \"\"  (the tape has no more)\n"
            "  got       78  \"x\"\n"
            "            ++\n");
}

TEST(ReportText, ColourOnlyWhenAsked) {
  EXPECT_THAT(to_text(mismatched()), Not(HasSubstr("\033")));
  EXPECT_THAT(to_text(mismatched(), true), HasSubstr("\033[31mdata mismatch\033[0m: the driver wrote"));
  EXPECT_THAT(to_text(passed(), true), HasSubstr("\033[32mpass\033[0m"));
}

TEST(ReportText, WhereTheDeviceIsJudgedItStandsInTheDriversPlace) {
  RunReport report = mismatched();
  report.writer = Writer::device;
  report.mismatch = wrong_byte();
  report.mismatch->tape_offset = 20;
  const std::string text = to_text(report);
  EXPECT_THAT(
      text, StartsWith("data mismatch: the device sent \"VX\\n\" where the tape has \"VV\\n\"\n"
                       "  at byte 1 of its piece no. 3 (byte 17 of all it sent, 2.000001 s after the open"));
  EXPECT_THAT(text, AllOf(HasSubstr("byte 20 of its answers"),
                          HasSubstr("from the device 12 of 42 bytes as recorded, to the device 3222 of 3222"),
                          Not(HasSubstr("driver"))));
  report.verdict = Verdict::incomplete;
  report.mismatch.reset();
  report.next_expected = bytes_of("QT\n");
  report.next_expected_block = 3;
  EXPECT_THAT(to_text(report), AllOf(StartsWith("incomplete: the device never sent \"QT\\n\"\n"),
                                     HasSubstr("of the device's answers: "), Not(HasSubstr("driver"))));
}

TEST(ReportJson, DirectionsKeepTheirNamesWhoeverIsJudged) {
  RunReport report = passed();
  report.writer = Writer::device;
  EXPECT_THAT(to_json(report), AllOf(HasSubstr(R"("to_driver":{"bytes":42,"matched":42,"of":42},)"
                                               R"("from_driver":{"bytes":3222,"of":3222},)"),
                                     HasSubstr(R"("writer":"device")")));
  EXPECT_THAT(run_json(report), HasSubstr(R"("bytes":{"to_driver":42,"from_driver":3222})"));
}

TEST(ReportText, ATapeNameCannotSpoilTheTerminal) {
  RunReport report = passed();
  report.tape = "a\033[2Jb";
  EXPECT_THAT(to_text(report), HasSubstr("a\\x1b[2Jb"));
  report.tape = "M\u00fcller";
  EXPECT_THAT(to_text(report), HasSubstr("M\u00fcller: "));
}

// Three settings, of which the driver made `made`.
RunReport with_settings(std::uint64_t made, bool checked) {
  RunReport report = passed();
  report.settings = {.recorded = 3, .made = made, .missing = {}};
  const std::array<unsigned, 3> rates = {300, 1200, 2400};
  for (std::size_t i = made; i < rates.size(); ++i) {
    const auto at = tape_time_us(static_cast<std::int64_t>(i) * 1'000'000);
    report.settings.missing.push_back({at, LineView::of(SeenSettings{.baud = rates.at(i), .stop_bits = 1})});
  }
  report.settings_checked = checked;
  if (checked && made < 3) report.verdict = Verdict::settings_mismatch;
  return report;
}

TEST(ReportSettings, ThoseThatWereNotMadeAreANoteOrTheVerdict) {
  EXPECT_THAT(
      to_text(with_settings(2, false)),
      AllOf(StartsWith("pass  laser.log"),
            HasSubstr("\n  settings  the driver never made its line 2400 baud, 1 stop bit, as the tape "
                      "has it at 2.000000 s\n")));
  EXPECT_THAT(to_text(with_settings(2, true)),
              AllOf(StartsWith("settings mismatch: the driver never made its line 2400 baud, 1 stop bit, as "
                               "the tape has it at 2.000000 s\n  laser.log"),
                    Not(HasSubstr("  settings  "))));
}

TEST(ReportSettings, SignalsAreAmongThem) {
  RunReport report = with_settings(2, true);
  report.settings.missing[0].what = LineView::of(LineSignal{LineSignal::Name::dtr, true});
  EXPECT_THAT(to_text(report),
              StartsWith("settings mismatch: the driver never switched dtr on, as the tape has "
                         "it at 2.000000 s\n"));
  EXPECT_THAT(to_json(report), HasSubstr(R"("missing":[{"tape_us":2000000,"dtr":"on"}])"));
  report = with_settings(0, true);
  report.settings.missing[1].what = LineView::of(LineSignal{LineSignal::Name::brk, true});
  EXPECT_THAT(to_text(report),
              StartsWith("settings mismatch: the driver made none of the 3 settings and signals "
                         "on the tape; it never made its line 300 baud"));
}

TEST(ReportSettings, FurtherOnesFollowAndNoneAtAllIsSaidOnce) {
  EXPECT_THAT(
      to_text(with_settings(1, true)),
      AllOf(StartsWith("settings mismatch: the driver never made its line 1200 baud"),
            HasSubstr("\n  settings  nor 2400 baud, 1 stop bit, as the tape has it at 2.000000 s\n")));
  EXPECT_THAT(to_text(with_settings(0, true)),
              AllOf(StartsWith("settings mismatch: the driver made none of the 3 settings on the tape; it "
                               "never made its line 300 baud"),
                    Not(HasSubstr("  settings  "))));
  RunReport many = with_settings(1, false);
  many.settings.recorded = 100;
  many.settings.missing.resize(SettingsReport::kMostMissing);
  EXPECT_THAT(to_text(many), HasSubstr("  settings  and 91 more\n"));
}

TEST(ReportSettings, ATapeWithoutAnySaysSoWhereTheyWereToBeChecked) {
  RunReport none = passed();
  EXPECT_THAT(to_text(none), Not(HasSubstr("settings")));
  none.settings_checked = true;
  EXPECT_THAT(to_text(none),
              AllOf(StartsWith("pass"), HasSubstr("  settings  none to check: the tape has none")));
  EXPECT_THAT(to_text(with_settings(3, true)), AllOf(StartsWith("pass"), Not(HasSubstr("settings"))));
}

TEST(ReportSettings, AreInJsonWithTheExitStatusOfAMismatch) {
  const std::string json = to_json(with_settings(2, true));
  EXPECT_THAT(json, StartsWith(R"({"verdict":"settings-mismatch","exit":3,)"));
  EXPECT_THAT(json, HasSubstr(R"("settings":{"recorded":3,"made":2,)"
                              R"("missing":[{"tape_us":2000000,"baud":2400,"stopbits":1}],"checked":true})"));
}

}  // namespace
}  // namespace porttape
