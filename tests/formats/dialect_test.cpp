#include "libport/formats/dialect.hpp"

#include <fmt/format.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/formats/shipped_dialects.hpp"
#include "tests/formats/read_log.hpp"

namespace porttape {
namespace {

using test::read_log;
using test::ReadLog;
using test::TempDir;
using testing::AllOf;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// As users post them.
constexpr const char* kBellows =
    "2020-08-13 12:09:34 DEBUG (bellows.thread_0) [bellows.uart] Data frame: b'2551b1577e'\n"
    "\x1b[36m2020-08-13 12:09:34 DEBUG (bellows.thread_0) [bellows.uart] Sending: b'83401b7e'\x1b[0m\n"
    "2020-08-13 12:09:34 DEBUG (MainThread) [bellows.ezsp.protocol] Application frame 128 received: "
    "b'42d1b1'\n"
    "2020-08-13 12:09:41 DEBUG (bellows.thread_0) [bellows.uart] Sending: b'5356\n";

TEST(Dialect, PythonHex) {
  const TempDir dir;
  EXPECT_EQ(test::detected(kBellows), "python-hex");
  const ReadLog tape = read_log(dir, "python-hex", kBellows);
  EXPECT_THAT(tape.lines, ElementsAre("r 0 %Q\\xb1W~", "w 1 \\x83@\\x1b~"));
  EXPECT_THAT(tape.problems, ElementsAre("lines 3 and 4: something else; left out"));
  EXPECT_THAT(tape.guesses, ElementsAre("its times are UTC"));
  const ReadLog escaped =
      read_log(dir, "python-hex",
               "Jul 04 17:00:27 host hass[2557]: DEBUG:bellows.uart:Data frame: b'tQ\\xb1*~'\n"
               "Jul 04 17:00:28 host hass[2557]: DEBUG:bellows.uart:Sending: b'\\x80px~'\n"
               "Jul 04 17:00:28 host hass[2557]: DEBUG:bellows.uart:Sending: b\"a'b\"\n");
  EXPECT_THAT(escaped.lines, ElementsAre("r 0 tQ\\xb1*~", "w 1000000 \\x80px~", "w 1000000 a'b"));
  EXPECT_THAT(read_log(dir, "python-hex",
                       "2022-07-21 15:23:02,130 DEBUG :Sending: b'1272'\n"
                       "2022-07-21 15:23:02,140 DEBUG :Received data: 0x01 0x02\n")
                  .lines,
              ElementsAre("w 0 \\x12r", "r 10000 \\x01\\x02"));
}

TEST(Dialect, ZwaveJs) {
  const TempDir dir;
  const char* const log =
      "2021-04-05T10:12:13.123Z SERIAL » 0x01030015e9                                 (5 bytes)\n"
      "2021-04-05T10:12:13.125Z SERIAL « [ACK]                                        (0x06)\n"
      "2021-04-05T10:12:13.130Z CNTRLR   querying controller\n";
  EXPECT_EQ(test::detected(log), "zwave-js");
  const ReadLog tape = read_log(dir, "zwave-js", log);
  EXPECT_THAT(tape.lines, ElementsAre("w 0 \\x01\\x03\\x00\\x15\\xe9", "r 2000 \\x06"));
  EXPECT_THAT(tape.problems, ElementsAre(HasSubstr("line 3")));
}

TEST(Dialect, Printers) {
  const TempDir dir;
  const char* const log =
      "2021-03-04 23:59:59,900 - Changing monitoring state from \"Offline\" to \"Connecting\"\n"
      "2021-03-04 23:59:59,900 - Send: N0 M110 N0*125\n"
      "2021-03-05 00:00:00,150 - Recv: ok T:21.5 /0.0\n";
  EXPECT_EQ(test::detected(log), "octoprint");
  const ReadLog tape = read_log(dir, "octoprint", log);
  EXPECT_THAT(tape.lines, ElementsAre("w 0 N0 M110 N0*125\\n", "r 250000 ok T:21.5 /0.0\\n"));
  EXPECT_THAT(tape.problems, IsEmpty());
  EXPECT_THAT(read_log(dir, "octoprint", "SENT: M105\nRECV: ok\n").lines,
              ElementsAre("w 0 M105\\n", "r 1 ok\\n"));
}

// Written by ser2net 4.3.11.
TEST(Dialect, Ser2net) {
  const TempDir dir;
  const char* const log =
      "2026/11/23 22:42:42 OPEN (ipv4,127.0.0.1,50518)\n"
      "2026/11/23 22:42:42 tcp  68 65 6c 6c 6f 20 73 65  |hello se|\n"
      "2026/11/23 22:42:42 tcp  0d 0a                    |..|\n"
      "2026/11/23 22:42:43 term 50 4f 4e 47 20 68 65 6c  |PONG hel|\n"
      "2026/11/23 22:42:43 CLOSE netcon (network read close)\n";
  EXPECT_EQ(test::detected(log), "ser2net");
  const ReadLog tape = read_log(dir, "ser2net", log);
  EXPECT_THAT(tape.lines, ElementsAre("w 0 hello se\\r\\n", "r 1000000 PONG hel"));
  EXPECT_THAT(tape.problems, IsEmpty());
}

TEST(Dialect, TheOthers) {
  const TempDir dir;
  EXPECT_THAT(read_log(dir, "interceptty", "<\t0x41 (A)\n<\t0x0d\n>\t0x4f (O)\n").lines,
              ElementsAre("w 0 A\\r", "r 1 O"));
  EXPECT_THAT(
      read_log(dir, "minicom", "[2024-01-02 10:00:00.500] boot\r\n[2024-01-02 10:00:01.000] ok\r\n").lines,
      ElementsAre("r 0 boot\\r\\n", "r 500000 ok\\r\\n"));
  EXPECT_THAT(read_log(dir, "picocom", "ok[0d][zz]\n").lines, ElementsAre("r 0 ok\\r[zz]\\n"));
}

TEST(Dialect, AFileOfAUsers) {
  const TempDir dir;
  const std::string file = dir / "meter.toml";
  {
    Result<NewFile> toml = NewFile::create(file, false);
    ASSERT_TRUE(toml);
    ASSERT_TRUE(
        toml->add(std::string_view("unit = \"ms\"\nwrite = [\"OUT\"]\nread = [\"IN\"]\n[[line]]\n"
                                   "pattern = '^(?P<time>\\d+) (?P<direction>\\w+) (?P<bytes>.*)$'\n"
                                   "bytes = \"decimal\"\n")));
    ASSERT_TRUE(toml->finish());
  }
  const ReadLog tape = read_log(
      dir, "dialect", "1500 OUT 65 66\n1750 IN [67, 300]\n1750 IN [67, 68]\n1751 ERR 1\n", {.dialect = file});
  EXPECT_THAT(tape.lines, ElementsAre("w 0 AB", "r 250000 CD"));
  EXPECT_THAT(tape.problems, ElementsAre("lines 2 and 4: bytes are damaged; left out"));
}

TEST(Dialect, ThoseThatComeWithPorttapeAreFormats) {
  ASSERT_FALSE(shipped_dialects().empty());
  for (const ShippedDialect& shipped : shipped_dialects()) {
    EXPECT_TRUE(Dialect::parse(std::string(shipped.toml), "d.toml")) << shipped.name;
    EXPECT_THAT(shipped.toml, HasSubstr(fmt::format("name = \"{}\"\n", shipped.name)));
    const Format* const format = find_format(shipped.name);
    ASSERT_NE(format, nullptr) << shipped.name;
    Evidence nothing = Evidence::of("evidence", "");
    const TempDir dir;
    ImportTape tape(literal_tape(dir / "t"), {.sync = false}, {}, "evidence");
    EXPECT_TRUE(format->import_tape(nothing, tape, {})) << shipped.name;
  }
}

TEST(Dialect, OfManyLinesWithTheSameProblemTheFirstOnesAreTold) {
  const TempDir dir;
  EXPECT_THAT(read_log(dir, "octoprint", "a\nSend: b\nc\n").problems,
              ElementsAre("lines 1 and 3: something else; left out"));
  EXPECT_THAT(read_log(dir, "octoprint", "a\nb\nc\nd\ne\nSend: x\n").problems,
              ElementsAre("lines 1, 2, 3, 4 and 5: something else; left out"));
  EXPECT_THAT(read_log(dir, "octoprint", "a\nb\nc\nd\ne\nf\ng\nSend: x\n").problems,
              ElementsAre("lines 1, 2, 3, 4, 5 and 2 more: something else; left out"));
}

TEST(Dialect, WhatIsWrongInAFileIsToldByItsLine) {
  const auto error_of = [](const std::string& text) {
    return Dialect::parse(text, "d.toml").error().message;
  };
  EXPECT_THAT(error_of("x = \n"), HasSubstr("d.toml:1"));
  EXPECT_THAT(error_of(""), HasSubstr("[[line]] is missing"));
  EXPECT_THAT(error_of("[[line]]\npattern = '('\n"), HasSubstr("is no regular expression"));
  EXPECT_THAT(error_of("[[line]]\npattern = 'a'\n"), HasSubstr("no group (?P<bytes>"));
  EXPECT_THAT(error_of("[[line]]\npattern = '(?P<bytes>a)'\n"), HasSubstr("no group (?P<direction>"));
  EXPECT_THAT(error_of("[[line]]\npattern = '(?P<bytes>a)'\ndirection = \"x\"\n"), HasSubstr("direction"));
  EXPECT_THAT(error_of("wirte = []\n[[line]]\npattern = '(?P<bytes>a)'\ndirection = \"w\"\n"),
              HasSubstr("wirte"));
}

TEST(Dialect, OfARowAsLongAsRowsGetTheNextOneOfThatTimeIsMore) {
  const TempDir dir;
  const ReadLog tape = read_log(dir, "ser2net",
                                "2026/11/23 22:42:42 tcp  31 32 33 34 35 36 37 38  |12345678|\n"
                                "2026/11/23 22:42:42 term 41                       |A|\n"
                                "2026/11/23 22:42:42 tcp  42                       |B|\n"
                                "2026/11/23 22:42:42 term 43                       |C|\n"
                                "2026/11/23 22:42:43 tcp  31 32 33 34 35 36 37 38  |12345678|\n"
                                "2026/11/23 22:42:44 tcp  39                       |9|\n");
  EXPECT_THAT(tape.lines,
              ElementsAre("w 0 12345678", "r 0 A", "w 1 B", "r 1 C", "w 1000000 12345678", "w 2000000 9"));
  EXPECT_THAT(tape.problems, IsEmpty());
}

TEST(Dialect, ATimeThatIsNoneIsTold) {
  const TempDir dir;
  const ReadLog tape = read_log(dir, "octoprint", "2021-03-04 25:59:59,900 - Send: a\n");
  EXPECT_THAT(tape.lines, ElementsAre("w 0 a\\n"));
  EXPECT_THAT(tape.problems, ElementsAre("line 1: no time"));
}

// Its row may go on: it is put on the tape at the log's end.
TEST(Dialect, ATimeThatATapeHasNoRoomForIsToldByItsLine) {
  const TempDir dir;
  EXPECT_THAT(read_log(dir, "ser2net",
                       "1970/01/01 00:00:00 term 41                       |A|\n"
                       "2170/01/01 00:00:00 tcp  31 32 33 34 35 36 37 38  |12345678|\n")
                  .error,
              AllOf(HasSubstr("evidence:2"), HasSubstr("a tape has no room for the time")));
}

TEST(Dialect, BinaryDataIsNoLog) {
  EXPECT_EQ(test::detected("SENT: M105\nRECV: ok\n"), "octoprint");
  EXPECT_EQ(test::detected(std::string_view("SENT: M105\nRECV: ok\n\0\1", 23)), "");
}

TEST(LogTime, EveryForm) {
  const auto at = [](std::string_view text) { return parse_log_time(text, LogUnit::seconds); };
  EXPECT_EQ(at("1970-01-02 00:00:01,5")->us, 86'401'500'000);
  EXPECT_EQ(at("1970-01-02T02:00:01.000001+02:00")->us, 86'401'000'001);
  EXPECT_EQ(at("10:12:13.5")->us, 36'733'500'000);
  EXPECT_EQ(at("12.25")->us, 12'250'000);
  EXPECT_EQ(at("1795470615.334218")->kind, LogTime::Kind::epoch);
  EXPECT_FALSE(at("25:99:00"));
  EXPECT_FALSE(at("2020-13-01 00:00:00"));
  LogClock clock;
  EXPECT_EQ(clock.since_first(*at("23:59:59")), 0);
  EXPECT_EQ(clock.since_first(*at("00:00:01")), 2'000'000);
  LogClock of_year;
  EXPECT_EQ(of_year.since_first(*at("Dec 31 23:59:59")), 0);
  EXPECT_EQ(of_year.since_first(*at("Jan  1 00:00:01")), 2'000'000);
  EXPECT_FALSE(of_year.since_first(*at("12:00:00")));
}

}  // namespace
}  // namespace porttape
