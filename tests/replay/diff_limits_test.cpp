// What came beside what the tape has: at the limits of what is compared and shown.

#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/base/checksum.hpp"
#include "libport/replay/byte_diff.hpp"
#include "libport/replay/checksum_guess.hpp"
#include "libport/replay/diagnosis.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/report_words.hpp"
#include "tests/support/memory_tape.hpp"
#include "tests/support/tape_bytes.hpp"

namespace porttape::test {
namespace {

using testing::HasSubstr;
using testing::Not;

RunReport against(const MemoryTape& tape, std::string_view came, std::uint64_t offset = 0) {
  RunReport report;
  report.verdict = Verdict::data_mismatch;
  report.mismatch.emplace();
  report.mismatch->tape_offset = offset;
  report.mismatch->came = report.mismatch->got = bytes_of(came);
  MemorySource source(tape);
  report.excerpt = std::make_shared<const TapeExcerpt>(read_excerpt(source, offset, kFrameGap).value());
  diagnose(report);
  return report;
}

// The texts of the frames that it is cut into, with a bar between them.
std::string cut(const MemoryTape& tape, std::string_view came) {
  MemorySource source(tape);
  std::string out;
  for (const CameFrame& frame : cut_came(read_excerpt(source, 0, kFrameGap).value(), as_bytes(came)))
    out += (out.empty() ? "" : "|") + std::string(as_text(frame.bytes)) + (frame.open_end ? ".." : "");
  return out;
}

MemoryTape asking(const std::vector<std::string>& requests) {
  MemoryTape tape;
  for (std::size_t i = 0; i < requests.size(); ++i) {
    const auto at = static_cast<std::int64_t>(i) * 10'000;
    tape.write(at, requests[i]).read(at + 1000, "ok");
  }
  return tape;
}

TEST(DiffLimits, TheFirstHalfKilobyteIsCompared) {
  EXPECT_EQ(diff_bytes(Bytes(512, 'a'), Bytes(512, 'a')).size(), 512U);
  EXPECT_EQ(diff_bytes(Bytes(513, 'a'), Bytes(512, 'a')).size(), 512U);
  EXPECT_EQ(diff_bytes(Bytes(512, 'a'), Bytes(513, 'a')).size(), 512U);
}

TEST(DiffLimits, EightBytesAreShownBeforeTheFirstDifference) {
  EXPECT_THAT(to_text(against(asking({"12345678X90\n"}), "12345678Y90\n")),
              HasSubstr("\"12345678X90\\n\"  request 1\n"));
  EXPECT_THAT(to_text(against(asking({"012345678X90\n"}), "012345678Y90\n")),
              HasSubstr("..\"12345678X90\\n\"  request 1\n"));
}

TEST(DiffLimits, SixteenBytesAreShownFromTheFirstDifferenceOn) {
  const std::string fourteen(14, 'z');
  EXPECT_THAT(to_text(against(asking({"X" + fourteen + "\n"}), "Y" + fourteen + "\n")),
              HasSubstr(" 0a  \"X" + fourteen + "\\n\"  request 1\n"));
  EXPECT_THAT(to_text(against(asking({"X" + fourteen + "z\n"}), "Y" + fourteen + "z\n")),
              HasSubstr(" ..  \"X" + fourteen + "z\"..  request 1\n"));
}

TEST(DiffLimits, SixteenBytesAreShownOfAFrameOfOneSide) {
  const std::string fifteen(15, 'z');
  const std::string text = to_text(against(asking({"a\n"}), fifteen + "\n" + fifteen + "z\n"));
  EXPECT_THAT(text,
              HasSubstr("  added     " + spaced_hex(bytes_of(fifteen)) + " 0a  \"" + fifteen + "\\n\"\n"));
  EXPECT_THAT(text, HasSubstr("  added     " + spaced_hex(Bytes(16, 'z')) + " ..  \"" + fifteen + "z\"..\n"));
}

TEST(DiffLimits, TenRowsAreShown) {
  std::string came;
  for (int i = 0; i < 11; ++i) came += "unknown" + std::to_string(100 + i) + "\n";
  const std::string text = to_text(against(asking({"a\n"}), came));
  EXPECT_THAT(text, HasSubstr("unknown109"));
  EXPECT_THAT(text, Not(HasSubstr("unknown110")));
}

TEST(DiffLimits, AFrameThatTheTapeHasTwiceIsTheNearer) {
  const MemoryTape tape = asking({"A\n", "B\n", "C\n", "D\n", "E\n", "A\n"});
  EXPECT_THAT(to_text(against(tape, "A\nD\n", 6)), HasSubstr("\"A\\n\"  as request 6\n"));
  EXPECT_THAT(to_text(against(tape, "A\nC\n", 4)), HasSubstr("\"A\\n\"  as request 1\n"));
  const MemoryTape both = asking({"A\n", "B\n", "C\n", "D\n", "A\n"});
  EXPECT_THAT(to_text(against(both, "A\nC\n", 4)), HasSubstr("\"A\\n\"  as request 1\n")) << "as near";
}

TEST(DiffLimits, AFrameOfAtLeastHalfTheBytesResemblesIt) {
  TapeFrame frame;
  frame.bytes = bytes_of("abcd");
  frame.length = 4;
  EXPECT_TRUE(resembles(frame, {bytes_of("abxy"), false}));
  EXPECT_FALSE(resembles(frame, {bytes_of("axyz"), false}));
}

TEST(DiffLimits, LinesAreCutAtTheirEndsAndBinaryWhereTheTapesFramesBegin) {
  EXPECT_EQ(cut(asking({"a\n"}), "x\r\ny\nz"), "x\r\n|y\n|z..");
  EXPECT_EQ(cut(asking({"ab", "cd"}), "xabcdy"), "x|ab|cd|y..");
  EXPECT_EQ(cut(asking({"ab", "abc"}), "abcab"), "abc|ab") << "the longest that is there";
}

TEST(DiffLimits, AFrameOfOneByteIsFoundAtTheFrontAlone) {
  EXPECT_EQ(cut(asking({"ab", "q"}), "q"), "q");
  EXPECT_EQ(cut(asking({"ab", "q"}), "xqyab"), "xqy|ab");
}

// Three frames that end with this checksum, and the first of them with another byte.
struct Summed {
  std::vector<Bytes> frames;
  Bytes wrong;
};

Bytes with_sum(const Bytes& bytes, std::string_view kind, bool low_first, std::uint32_t change) {
  const ChecksumKind& sum = *find_checksum(kind);
  const std::uint32_t value = checksum_of(sum, bytes) ^ change;
  Bytes out = bytes;
  for (std::size_t i = 0; i < sum.size(); ++i) {
    const std::size_t place = low_first ? i : sum.size() - 1 - i;
    out.push_back(static_cast<Byte>(value >> (8 * place)));
  }
  return out;
}

std::string guessed(std::string_view kind, bool low_first = false, std::uint32_t change = 0) {
  std::vector<Bytes> frames;
  for (const std::string_view text : {"\x02one", "\x02other", "\x02thirds", "\x02 4", "\x02 five "})
    frames.push_back(with_sum(bytes_of(text), kind, low_first, change));
  const auto guess = ChecksumGuess::of({frames.begin(), frames.end()});
  if (!guess) return "none";
  Bytes wrong = frames[0];
  wrong.back() ^= 1;
  EXPECT_EQ(guess->field(frames[0])->right, guess->field(frames[0])->has);
  EXPECT_NE(guess->field(wrong)->right, guess->field(wrong)->has);
  return std::string(guess->name());
}

TEST(ChecksumGuessLimits, KnowsTheSumsOfTheCatalogueInBothOrders) {
  EXPECT_EQ(guessed("CRC-16/MODBUS", true), "CRC-16/MODBUS");
  EXPECT_EQ(guessed("CRC-16/MODBUS"), "none");
  EXPECT_EQ(guessed("CRC-16/XMODEM"), "CRC-16/XMODEM");
  EXPECT_EQ(guessed("CRC-16/CCITT-FALSE"), "CRC-16/CCITT-FALSE");
  EXPECT_EQ(guessed("FLETCHER-UBX"), "Fletcher");
  EXPECT_EQ(guessed("XOR"), "XOR");
  EXPECT_EQ(guessed("SUM-8"), "sum");
  EXPECT_EQ(guessed("LRC"), "LRC");
  EXPECT_EQ(guessed("SUM-8", false, 0xFF), "inverted sum");
}

ChecksumGuess nmea() {
  const std::vector<std::string> lines = {"$PMTK220,200*2C\r\n", "$PMTK251,9600*17\r\n", "$PMTK605*31\r\n"};
  return ChecksumGuess::of({as_bytes(lines[0]), as_bytes(lines[1]), as_bytes(lines[2])}).value();
}

TEST(ChecksumGuessLimits, DigitsAreAsTheFrameHasThem) {
  const auto right = [](std::string_view frame) {
    return std::string(as_text(nmea().field(as_bytes(frame))->right));
  };
  EXPECT_EQ(right("$z`*1B"), "1A");
  EXPECT_EQ(right("$z`*1b"), "1a");
  EXPECT_EQ(right("$z`*2a"), "1a");
  EXPECT_EQ(right("$zz*99"), "00");
}

TEST(ChecksumGuessLimits, AFrameThatHasNothingButItsSumHasNoField) {
  EXPECT_TRUE(nmea().field(as_bytes("$A*41\r\n")).has_value());
  EXPECT_FALSE(nmea().field(as_bytes("$*00\r\n")).has_value());
  EXPECT_FALSE(nmea().field(as_bytes("\r\n")).has_value());
}

}  // namespace
}  // namespace porttape::test
