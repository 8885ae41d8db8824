#include "libport/taped/redact_tape.hpp"

#include <random>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/rules/rules_reader.hpp"
#include "libport/tape/event_file.hpp"
#include "tests/support/random_tape.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::MemoryTape;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;
using Where = TapeRedaction::Where;

class RedactTapeTest : public testing::Test {
 protected:
  Result<RedactedTape> redact(const TapePaths& source, const std::string& rules, bool identity = false,
                              bool dry_run = false) {
    found.clear();
    made = literal_tape(dir / ("made" + std::to_string(++made_count)));
    Result<RuleSet> set = read_rules(rules, "my.rules");
    if (!set) return set.error();
    return redact_tape(source, made,
                       {.rules = *set,
                        .key = {3, 4},
                        .identity = identity,
                        .dry_run = dry_run,
                        .writer = {.sync = false},
                        .progress = {},
                        .on_redaction = [this](const TapeRedaction& each) { found.push_back(each); }});
  }
  [[nodiscard]] std::string header() const {
    auto reader = TapeReader::open(made);
    return reader ? reader->header_line() : reader.error().message;
  }

  test::TempDir dir;
  int made_count = 0;
  TapePaths made;
  std::vector<TapeRedaction> found;
};

TEST_F(RedactTapeTest, OfBytesThatAreNotTheRecordedOnesNothingIsMade) {
  const TapePaths tape = test::write_tape(literal_tape(dir / "t.log"),
                                          MemoryTape().open(0).write(100, "secret").read(200, "yes"),
                                          {.device = "d", .driver = "p", .id = "0123"});
  Bytes bytes = test::read_file(tape.read);
  bytes.back() = 't';
  test::write_file(tape.read, bytes);
  for (const char* frames : {"", "[[frame]]\nname='f'\nkind='idle'\nidle_ms=50\n"}) {
    const auto done = redact(tape, std::string(frames) + "[[redact]]\nname='s'\ntext='secret'\n");
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().code, Errc::damaged_tape);
    EXPECT_THAT(done.error().message, HasSubstr("t.logr is another tape's, or changed"));
    EXPECT_FALSE(std::filesystem::exists(made.read));
  }
}

TEST_F(RedactTapeTest, ASecretOverSeveralBlocksIsFound) {
  const TapePaths tape =
      test::write_tape(literal_tape(dir / "t.log"), MemoryTape()
                                                        .open(0)
                                                        .write(100, "PASS=sec")
                                                        .write(150, "")
                                                        .read(160, "x")
                                                        .write(200, "r")
                                                        .write(300, "et9;ok")
                                                        .event(350, event::Mark{"it is secret9"})
                                                        .read(400, "not secret8")
                                                        .close(500));
  const std::string rules =
      "[[redact]]\nname='password'\npattern='PASS=(\\w+)'\nwith='*'\n[[redact]]\nname='again'\ntext='secret9'"
      "\nwith='*'\n";
  const auto done = redact(tape, rules);
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_THAT(test::lines_on(made),
              ElementsAre(HasSubstr("open"), "w 100 PASS=***", "w 150 ", "r 160 x", "w 200 *", "w 300 ***;ok",
                          HasSubstr("it is *******"), "r 400 not secret8", HasSubstr("close")));
  EXPECT_EQ(done->rules[0].count, 1U);
  ASSERT_EQ(found.size(), 3U);
  EXPECT_EQ(found[0].offset, 5U);
  EXPECT_EQ(to_us(found[0].at), 100);
  EXPECT_EQ(found[2].where, Where::event);
  EXPECT_EQ(found[2].key, "text");
  EXPECT_EQ(found[2].offset, 6U);
}

TEST_F(RedactTapeTest, HeaderAndIdentityToo) {
  PortIdentity identity;
  identity.path = "/dev/ttyUSB0";
  identity.vid = 0x403;
  identity.pid = 0x6001;
  identity.serial = "PT0001X";
  const TapePaths tape =
      test::write_tape(literal_tape(dir / "lab7.log"), MemoryTape().open(0).close(5),
                       {.device = "serial:/dev/serial/by-id/usb-FTDI_PT0001X-if00",
                        .driver = "pty:/home/alice/p",
                        .host = "bench",
                        .id = "0123",
                        .zero = TapeZero{"2024-05-06T07:08:09.000000Z", 5'000'000, "boot-id"},
                        .identity = identity});
  const std::string rules = "[[redact]]\nname='user'\ntext='alice'\nwith='u'\n";
  ASSERT_TRUE(redact(tape, rules));
  EXPECT_THAT(header(), HasSubstr("/home/uuuuu/p"));
  EXPECT_THAT(header(), HasSubstr("PT0001X"));
  EXPECT_THAT(header(), HasSubstr(R"("by":"redact")"));
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].where, Where::header);
  EXPECT_EQ(found[0].key, "driver");
  const auto done = redact(tape, rules, true);
  ASSERT_TRUE(done);
  EXPECT_TRUE(done->identity_gone);
  for (const char* const secret : {"PT0001X", "bench", "boot-id", "identity", "alice"})
    EXPECT_THAT(header(), Not(HasSubstr(secret)));
  EXPECT_THAT(header(), HasSubstr("usb-FTDI_xxxxxxx-if00"));
  EXPECT_THAT(header(), HasSubstr("2024-05-06T07:08:09"));
}

// A tape with these lines of events.
TapePaths tape_of_lines(const TapePaths& paths, const std::string& header,
                        const std::vector<std::string>& lines) {
  auto tape = NewTape::create(paths, std::string_view(header), {.sync = false});
  if (!tape) throw std::runtime_error(tape.error().message);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    if (!tape->event_line(tape_time_us(static_cast<std::int64_t>(i)), lines[i]))
      throw std::runtime_error(lines[i]);
  }
  if (!tape->finish(tape->latest())) throw std::runtime_error("no tape");
  return paths;
}

TEST_F(RedactTapeTest, OnlyWordsOfTheFormatInTheirPlaceAreLeftAlone) {
  const std::string header =
      R"({"format":"porttape-events","version":1,"transport":"driver","tool":"made by driver","state":"on"})";
  const TapePaths tape =
      tape_of_lines(literal_tape(dir / "t.log"), header,
                    {R"({"t_us":0,"event":"modem","line":"dtr","state":"on","by":"driver"})",
                     R"({"t_us":1,"event":"modem","line":"driver","state":"driver","by":"on"})",
                     R"({"t_us":2,"event":"snow","line":"dtr","state":"on","by":"driver"})",
                     R"({"t_us":3,"event":"mark","text":"x","id":"driver","kind":"drop"})"});
  ASSERT_TRUE(redact(tape, "[[redact]]\nname='a'\npattern='driver|on|dtr|drop'\nwith='-'\n"));
  EXPECT_THAT(RedactTapeTest::header(), HasSubstr(R"("transport":"------")"));
  EXPECT_THAT(RedactTapeTest::header(), HasSubstr(R"("tool":"made by ------")"));
  EXPECT_THAT(RedactTapeTest::header(), HasSubstr(R"("state":"--")"));
  EXPECT_THAT(test::lines_on(made),
              ElementsAre(R"({"t_us":0,"event":"modem","line":"dtr","state":"on","by":"driver"})",
                          R"({"t_us":1,"event":"modem","line":"------","state":"------","by":"--"})",
                          R"({"t_us":2,"event":"snow","line":"---","state":"--","by":"------"})",
                          R"({"t_us":3,"event":"mark","text":"x","id":"------","kind":"----"})"));
}

TEST_F(RedactTapeTest, WhatCannotBeReplacedIsToldWithoutIt) {
  const std::string header = R"({"format":"porttape-events","version":1,"badge":4711})";
  const TapePaths tape =
      tape_of_lines(literal_tape(dir / "t.log"), header,
                    {R"({"t_us":0,"event":"settings","baud":4711})",
                     R"({"t_us":1,"event":"is4711","list":[{"my4711":"the 4711"}],"n":14711.5})",
                     R"({"t_us":2,"event":"is4711"})"});
  const auto done = redact(tape, "[[redact]]\nname='a'\ntext='4711'\nwith='-'\n");
  ASSERT_TRUE(done) << done.error().message;
  std::vector<std::string> left;
  for (const UnredactedText& each : done->left)
    left.push_back(std::to_string(static_cast<int>(each.what)) + " " + each.key + " " +
                   std::to_string(to_us(each.first)) + " " + std::to_string(each.count));
  EXPECT_THAT(left, ElementsAre("0 badge 0 1", "2 is---- 1 2", "1 list.my---- 1 1", "0 n 1 1"));
  EXPECT_THAT(test::lines_on(made)[1], HasSubstr(R"("my4711":"the ----")"));
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].key, "list.my----");
}

TEST_F(RedactTapeTest, ADryRunTellsTheSameAndMakesNothing) {
  const TapePaths tape =
      test::write_tape(literal_tape(dir / "t.log"), MemoryTape().write(1, "abc").read(2, "cab"));
  const std::string rules = "[[redact]]\nname='a'\npattern='a.'\n[[redact]]\nname='none'\ntext='zzz'\n";
  ASSERT_TRUE(redact(tape, rules));
  const std::size_t count = found.size();
  EXPECT_EQ(count, 3U);  // the header's tool is porttape
  const auto dry = redact(tape, rules, false, true);
  ASSERT_TRUE(dry);
  EXPECT_EQ(found.size(), count);
  EXPECT_EQ(dry->rules[1].count, 0U);
  EXPECT_FALSE(std::filesystem::exists(made.read));
}

TEST_F(RedactTapeTest, NothingIsMadeWhereASecretMayGoOn) {
  const TapePaths tape =
      test::write_tape(literal_tape(dir / "t.log"), MemoryTape().write(1, "=" + std::string(50, 'a')));
  const auto done = redact(tape, "[[redact]]\nname='a'\npattern='=(a+)'\nlongest=20\n");
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, Errc::usage);
  EXPECT_FALSE(std::filesystem::exists(made.read));
}

TEST_F(RedactTapeTest, FramesEndByPausesAndByTheOtherSide) {
  const TapePaths tape = test::write_tape(
      literal_tape(dir / "t.log"),
      MemoryTape().read(0, "ab").write(100, "q").read(200, "ab").read(10'000, "ab").read(10'010, "c"));
  ASSERT_TRUE(redact(tape,
                     "[[frame]]\nname='p'\nkind='idle'\nidle_ms=2\n"
                     "[[redact]]\nname='second'\nframe='p'\nat=1\nwith='-'\ndir='r'\n"));
  EXPECT_THAT(test::lines_on(made), ElementsAre("r 0 a-", "w 100 q", "r 200 a-", "r 10000 a-", "r 10010 -"));
}

// Blocks, their lengths and times are the tape's, whatever is replaced.
TEST_F(RedactTapeTest, BlocksStayWhatTheyAre) {
  std::mt19937 random(11);
  const auto choose = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
  for (int round = 0; round < 40; ++round) {
    const MemoryTape records = test::random_tape(choose, {.sessions = true, .gaps = true});
    const TapePaths tape = test::write_tape(literal_tape(dir / ("t" + std::to_string(round))), records);
    const auto done = redact(tape, "[[redact]]\nname='a'\npattern='a+b|cc'\nwith='-'\n");
    ASSERT_TRUE(done) << done.error().message;
    auto lines = test::lines_on(tape);
    auto after = test::lines_on(made);
    ASSERT_EQ(lines.size(), after.size());
    for (std::size_t i = 0; i < lines.size(); ++i) {
      ASSERT_EQ(lines[i].size(), after[i].size());
      for (std::size_t k = 0; k < lines[i].size(); ++k)
        ASSERT_TRUE(lines[i][k] == after[i][k] || after[i][k] == '-') << lines[i] << '\n' << after[i];
    }
  }
}

}  // namespace
}  // namespace porttape
