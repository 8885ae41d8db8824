// What came beside what the tape has.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/byte_diff.hpp"
#include "libport/replay/checksum_guess.hpp"
#include "libport/replay/context.hpp"
#include "libport/replay/diagnosis.hpp"
#include "libport/replay/report.hpp"
#include "tests/support/memory_tape.hpp"
#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using test::bytes_of;
using test::MemoryTape;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

// `a` the same, `-a` left out, `+b` added, `a>b` changed.
std::string diff(std::string_view recorded, std::string_view came, bool open_end = false) {
  std::string out;
  for (const ByteEdit& edit : diff_bytes(as_bytes(recorded), as_bytes(came), open_end)) {
    if (!out.empty()) out += ' ';
    if (edit.same()) {
      out += static_cast<char>(*edit.came);
    } else if (!edit.recorded) {
      out += std::string("+") + static_cast<char>(*edit.came);
    } else if (!edit.came) {
      out += std::string("-") + static_cast<char>(*edit.recorded);
    } else {
      out += std::string(1, static_cast<char>(*edit.recorded)) + '>' + static_cast<char>(*edit.came);
    }
  }
  return out;
}

TEST(ByteDiff, FindsTheFewestDifferences) {
  EXPECT_EQ(diff("abc", "abc"), "a b c");
  EXPECT_EQ(diff("abc", "axc"), "a b>x c");
  EXPECT_EQ(diff("abcd", "acd"), "a -b c d");
  EXPECT_EQ(diff("acd", "abcd"), "a +b c d");
  EXPECT_EQ(diff("", "ab"), "+a +b");
  EXPECT_EQ(diff("ab", ""), "-a -b");
  EXPECT_EQ(diff("AB", "BA"), "A>B B>A");
}

TEST(ByteDiff, AmongEqualBytesTheLastIsTheOneMoreOrLess) {
  EXPECT_EQ(diff("V!", "VV!"), "V +V !");
  EXPECT_EQ(diff("VVV!", "VV!"), "V V -V !");
}

TEST(ByteDiff, WhatMayStillComeIsNotLeftOut) {
  EXPECT_EQ(diff("abcdef", "abx", true), "a b c>x");
  EXPECT_EQ(diff("abcdef", "abx"), "a b -c -d -e f>x");
  EXPECT_EQ(diff("abc", "ab", true), "a b");
}

TEST(ByteDiff, OfTwoBeginningsThatAreAsGoodTheShorterIsTaken) {
  EXPECT_EQ(diff("ababX", "aab", true), "a +a b") << "\"abab\" differs by one byte as well";
}

TEST(ByteDiff, LongOnesAreBounded) {
  EXPECT_LE(diff_bytes(Bytes(100'000, 'a'), Bytes(100'000, 'b')).size(), 2 * kMostDiffed);
}

RunReport report_of(std::string_view came, std::uint64_t offset = 6) {
  static const MemoryTape tape = MemoryTape()
                                     .write(0, "VV\n")
                                     .read(4'000, "one\n")
                                     .write(10'000, "PP\n")
                                     .read(14'000, "two\n")
                                     .write(20'000, "GD0044\n")
                                     .read(24'000, "three\n")
                                     .write(30'000, "QT\n")
                                     .read(34'000, "four\n");
  RunReport report;
  report.verdict = Verdict::data_mismatch;
  report.mismatch.emplace();
  report.mismatch->tape_offset = offset;
  report.mismatch->came = report.mismatch->got = bytes_of(came);
  report.mismatch->delivered = 8;
  test::MemorySource source(tape);
  report.excerpt = std::make_shared<const TapeExcerpt>(read_excerpt(source, offset, kFrameGap).value());
  diagnose(report);
  return report;
}

TEST(FrameDiff, FramesThatAreLeftOutOrAddedStandAsSuch) {
  EXPECT_THAT(to_text(report_of("QT\n")),
              AllOf(HasSubstr("  left out  47 44 30 30 34 34 0a  \"GD0044\\n\"  request 3\n"
                              "  same      51 54 0a  \"QT\\n\"  request 4\n"),
                    Not(HasSubstr("  expected  "))));
  EXPECT_THAT(to_text(report_of("XX\nGD0044\nQT\n")),
              HasSubstr("  added     58 58 0a  \"XX\\n\"\n"
                        "  same      47 44 30 30 34 34 0a  \"GD0044\\n\"  request 3\n"
                        "  same      51 54 0a  \"QT\\n\"  request 4\n"));
  EXPECT_THAT(to_text(report_of("PP\nGD0044\n")),
              HasSubstr("  added     50 50 0a  \"PP\\n\"  as request 2\n"));
}

TEST(FrameDiff, AFrameThatIsAnotherHasItsBytesUnderEachOther) {
  EXPECT_THAT(to_text(report_of("GD00044\nQT\n")),
              HasSubstr("  expected  47 44 30 30 -- 34 34 0a  \"GD0044\\n\"  request 3\n"
                        "  got       47 44 30 30 30 34 34 0a  \"GD00044\\n\"\n"
                        "                        ++\n"
                        "  same      51 54 0a  \"QT\\n\"  request 4\n"));
  EXPECT_THAT(to_text(report_of("GD44\n")),
              HasSubstr("  expected  47 44 30 30 34 34 0a  \"GD0044\\n\"  request 3\n"
                        "  got       47 44 -- -- 34 34 0a  \"GD44\\n\"\n"
                        "                  -- --\n"));
}

TEST(FrameDiff, TheExchangesAroundAreTold) {
  RunReport report = report_of("GD0045\n");
  const std::string text = to_text(report);
  EXPECT_THAT(
      text,
      HasSubstr("  previous  request 2 \"PP\\n\", on the tape answered by \"two\\n\" (4 bytes after 4 ms), "
                "all of which came here\n"));
  EXPECT_THAT(
      text,
      HasSubstr(
          "  next      request 4 \"QT\\n\", on the tape answered by \"four\\n\" (5 bytes after 4 ms)\n"));
  report.mismatch->delivered = 5;
  EXPECT_THAT(to_text(report), HasSubstr("(4 bytes after 4 ms), of which 1 byte came here\n"));
}

TEST(FrameDiff, TheCauseStandsBelowTheFirstLine) {
  EXPECT_THAT(to_text(report_of("gd0044\n")), HasSubstr("\n  cause     another case of letters in request 3: "
                                                        "\"gd\" (67 64) where the tape has \"GD\" (47 44), "
                                                        "at byte 0\n  at byte "));
}

TEST(ReportJson, HasAllThatTheTextHas) {
  RunReport report = report_of("QT\n");
  report.think_times = ThinkTimes{.count = 2,
                                  .median = Micros{800},
                                  .most = Micros{1200},
                                  .most_at = 2,
                                  .recorded_median = Micros{900},
                                  .recorded_most = Micros{1100}};
  report.left_unread = 3;
  report.repeat_line = "porttape test --tape x -- ./a 'b c'";
  report.step_line = "porttape test --timeout 0 --tape x -- gdb --args ./a 'b c'";
  const std::string json = to_json(report);
  EXPECT_THAT(
      json,
      HasSubstr(R"("cause":{"kind":"early","certain":false,"text":"looks like request 3 left out, or swapped)"
                R"( with request 4, which came instead","exchange":3})"));
  EXPECT_THAT(
      json,
      HasSubstr(R"("diff":[{"op":"left-out","exchange":3,"part":1,"parts":1,"tape_us":20000,"tape_offset":6,)"
                R"("tape_hex":"4744303034340a","tape_bytes":7},{"op":"same","exchange":4,)"));
  EXPECT_THAT(json, HasSubstr(R"("came_hex":"51540a"}])"));
  EXPECT_THAT(
      json,
      HasSubstr(R"("answer":{"hex":"74776f0a","bytes":4,"delivered":4,"tape_us":14000,"until_us":14000}})"));
  EXPECT_THAT(
      json,
      HasSubstr(R"("latency_us":{"count":2,"median":800,"max":1200,"max_exchange":2,"recorded_median":900,)"
                R"("recorded_max":1100},"left_unread":3,"unread":null,"idle_us":0,"closed":false)"));
  EXPECT_THAT(
      json,
      HasSubstr(
          R"("commands":{"repeat":"porttape test --tape x -- ./a 'b c'","step":"porttape test --timeout)"));
  const std::string text = to_text(report);
  EXPECT_THAT(
      text,
      HasSubstr("  latency   from an answer to the next request the driver took 0.8 ms (median) and 1.2 ms "
                "(most, before request 2); on the tape 0.9 ms and 1.1 ms\n"));
  EXPECT_THAT(
      text,
      HasSubstr("  repeat    porttape test --tape x -- ./a 'b c'\n  step      porttape test --timeout 0"));
  EXPECT_THAT(text, HasSubstr("  unread    3 bytes of what was answered, when the driver closed\n"));
}

TEST(ChecksumGuess, NeedsMoreThanChance) {
  const Bytes one = {0x10, 0x22, 0x32};  // XOR
  const Bytes two = {0x11, 0x22, 0x33};
  const Bytes three = {0x12, 0x22, 0x30};
  EXPECT_FALSE(ChecksumGuess::of({one, two}).has_value());
  EXPECT_FALSE(ChecksumGuess::of({one, one, one}).has_value());
  const auto guess = ChecksumGuess::of({one, two, three});
  ASSERT_TRUE(guess.has_value());
  EXPECT_EQ(guess->name(), "XOR");
  EXPECT_EQ(guess->field(one)->at, 2U);
}

TEST(ChecksumGuess, KnowsNmea) {
  const std::vector<std::string> lines = {"$PMTK220,200*2C\r\n", "$PMTK251,9600*17\r\n", "$PMTK605*31\r\n"};
  const auto guess = ChecksumGuess::of({as_bytes(lines[0]), as_bytes(lines[1]), as_bytes(lines[2])});
  ASSERT_TRUE(guess.has_value());
  EXPECT_EQ(guess->name(), "XOR");
  EXPECT_EQ(as_text(guess->field(as_bytes("$PMTK220,200*2D\r\n"))->right), "2C");
}

}  // namespace
}  // namespace porttape
