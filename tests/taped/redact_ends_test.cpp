#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/rules/rules_reader.hpp"
#include "libport/taped/redact_tape.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

namespace fs = std::filesystem;
using test::MemoryTape;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

const std::string kRules = "[[redact]]\nname='s'\ntext='secret'\nwith='*'\n";

// What is at a tape's edges, and what of it is told.
class RedactEndsTest : public testing::Test {
 protected:
  Result<RedactedTape> redact(const TapePaths& source, const std::string& rules = kRules,
                              bool identity = false) {
    made = literal_tape(dir / ("made" + std::to_string(++count)));
    Result<RuleSet> set = read_rules(rules, "my.rules");
    if (!set) return set.error();
    RedactOptions options{.rules = *set, .key = {3, 4}, .identity = identity, .writer = {.sync = false}};
    options.progress = [this](std::uint64_t bytes) { progress.push_back(bytes); };
    return redact_tape(source, made, options);
  }
  // Of these blocks and lines of events, with an end at `end`.
  TapePaths tape(const MemoryTape& records, std::optional<std::int64_t> end, const TapeHeader& header = {}) {
    const TapePaths paths = literal_tape(dir / ("t" + std::to_string(++count)));
    auto tape = NewTape::create(paths, header, {.sync = false});
    EXPECT_TRUE(tape);
    for (const auto& entry : records.entries()) EXPECT_TRUE(test::put(*tape, entry));
    EXPECT_TRUE(tape->finish(end ? std::optional(tape_time_us(*end)) : std::nullopt));
    return paths;
  }
  static std::string last_event(const TapePaths& paths) {
    auto reader = TapeReader::open(paths, TapeReader::Select::events_only);
    std::string last;
    while (reader) {
      const auto next = reader->next();
      if (!next || !*next) break;
      if ((**next).event != nullptr) last = test::describe(**next);
    }
    return last;
  }

  test::TempDir dir;
  int count = 0;
  TapePaths made;
  std::vector<std::uint64_t> progress;
};

TEST_F(RedactEndsTest, HalfATapeWithoutEventsGetsNone) {
  const TapePaths whole = tape(MemoryTape().read(10, "a secret").write(20, "q"), 500);
  fs::remove(whole.events);
  auto done = redact(whole);
  ASSERT_TRUE(done);
  EXPECT_THAT(last_event(made), testing::StartsWith("end "));
  fs::resize_file(whole.write, fs::file_size(whole.write) - 1);
  done = redact(whole);
  ASSERT_TRUE(done);
  EXPECT_EQ(last_event(made), "");
  EXPECT_TRUE(done->torn_tail.has_value());
  fs::remove(whole.write);
  done = redact(whole);
  ASSERT_TRUE(done);
  EXPECT_EQ(last_event(made), "");
  EXPECT_THAT(done->torn_tail.value_or(""), HasSubstr("it has no w file"));
}

TEST_F(RedactEndsTest, TheEndIsWhereItWas) {
  ASSERT_TRUE(redact(tape(MemoryTape().open(0).read(10, "a secret"), 500)));
  EXPECT_EQ(last_event(made), "end 500");
}

TEST_F(RedactEndsTest, ATapeWithoutItsEndGetsNone) {
  ASSERT_TRUE(redact(tape(MemoryTape().open(1).read(10, "a secret"), {})));
  EXPECT_EQ(last_event(made), "open 1");
  EXPECT_THAT(test::lines_on(made), ElementsAre(HasSubstr("open"), "r 10 a ******"));
}

TEST_F(RedactEndsTest, ATapeWithoutEventsEndsWithItsLastBlock) {
  const TapePaths paths = tape(MemoryTape().read(10, "a secret"), 10);
  const std::string end = last_event(paths);
  EXPECT_THAT(end, testing::StartsWith("end "));
  fs::remove(paths.events);
  ASSERT_TRUE(redact(paths));
  EXPECT_EQ(last_event(made), end);
}

TEST_F(RedactEndsTest, ProgressIsTheBytesOfAllThreeFiles) {
  const TapePaths paths = tape(MemoryTape().open(0).write(5, "ask").read(10, "a secret").close(20), 20);
  ASSERT_TRUE(redact(paths));
  ASSERT_FALSE(progress.empty());
  EXPECT_TRUE(std::is_sorted(progress.begin(), progress.end()));
  const std::uint64_t blocks = fs::file_size(paths.read) + fs::file_size(paths.write);
  EXPECT_EQ(progress[1], blocks);
  EXPECT_GT(progress.back(), blocks);
  EXPECT_LE(progress.back(), blocks + fs::file_size(paths.events));
}

TEST_F(RedactEndsTest, ATornTailIsTold) {
  const TapePaths paths = tape(MemoryTape().open(0).read(10, "a secret").read(20, "more"), {});
  EXPECT_FALSE(redact(paths)->torn_tail.has_value());
  fs::resize_file(paths.read, fs::file_size(paths.read) - 1);
  const auto done = redact(paths);
  ASSERT_TRUE(done);
  EXPECT_TRUE(done->torn_tail.has_value());
}

TEST_F(RedactEndsTest, ASecretOfAnEventThatMayGoOnIsAnErrorAndNothingIsMade) {
  const auto done = redact(tape(MemoryTape().event(1, event::Mark{"=" + std::string(50, 'a')}), 2),
                           "[[redact]]\nname='a'\npattern='=(a+)'\nlongest=20\n");
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, Errc::usage);
  EXPECT_THAT(done.error().message, HasSubstr("may go on beyond 20 bytes"));
  EXPECT_FALSE(fs::exists(made.events));
}

TEST_F(RedactEndsTest, OfWhatIsLeftTheFirst64AreToldAndAllOfTheSameCounted) {
  const TapePaths paths = literal_tape(dir / "many");
  auto tape = NewTape::create(paths, TapeHeader{}, {.sync = false});
  ASSERT_TRUE(tape);
  for (int round = 0; round < 2; ++round) {
    for (int i = 0; i < 70; ++i) {
      const std::int64_t at = round * 100 + i;
      ASSERT_TRUE(tape->event_line(tape_time_us(at), "{\"t_us\":" + std::to_string(at) +
                                                         ",\"event\":\"secret" + std::to_string(i) + "\"}"));
    }
  }
  ASSERT_TRUE(tape->finish(tape->latest()));
  const auto done = redact(paths);
  ASSERT_TRUE(done) << done.error().message;
  ASSERT_EQ(done->left.size(), 64U);
  for (std::size_t i = 0; i < 64; ++i) {
    EXPECT_EQ(done->left[i].key, "******" + std::to_string(i));
    EXPECT_EQ(done->left[i].count, 2U);
    EXPECT_EQ(to_us(done->left[i].first), static_cast<std::int64_t>(i));
  }
}

TEST_F(RedactEndsTest, AnEndBeforeTheLastEventIsNoneOfTheTapes) {
  const TapePaths paths = literal_tape(dir / "goes-on");
  test::write_file(paths.read, test::block_bytes({{1, "a secret"}}));
  const std::string header = "{\"format\":\"porttape-events\",\"version\":1}\n";
  const std::string end = "{\"t_us\":2,\"event\":\"end\"}\n";
  test::write_file(paths.events, as_bytes(header + end));
  ASSERT_TRUE(redact(paths));
  EXPECT_THAT(last_event(made), testing::StartsWith("end "));
  test::write_file(paths.events, as_bytes(header + end + "{\"t_us\":3,\"event\":\"mark\"}\n"));
  ASSERT_TRUE(redact(paths));
  EXPECT_EQ(last_event(made), "mark 3");
}

TEST_F(RedactEndsTest, SaysWhichTapeWasMadeOrWouldBe) {
  const TapePaths source = tape(MemoryTape().read(1, "a secret"), 2);
  const TapePaths to = literal_tape(dir / "to.log");
  const Result<RuleSet> rules = read_rules(kRules, "my.rules");
  ASSERT_TRUE(rules);
  RedactOptions options{.rules = *rules,
                        .key = {3, 4},
                        .dry_run = true,
                        .writer = {.on_existing = OnExisting::next, .sync = false}};
  for (const auto& [dry_run, name] : {std::pair(true, "to.log"), {false, "to.log"}, {false, "to.2.log"}}) {
    options.dry_run = dry_run;
    const auto done = redact_tape(source, to, options);
    ASSERT_TRUE(done) << done.error().message;
    EXPECT_EQ(done->paths.file_name(), name);
    EXPECT_EQ(fs::exists(done->paths.read), !dry_run);
  }
}

TEST_F(RedactEndsTest, WhatIsLeftInAnotherPlaceOrByAnotherRuleIsToldApart) {
  const TapePaths paths = literal_tape(dir / "apart");
  auto tape =
      NewTape::create(paths, std::string_view(R"({"format":"porttape-events","version":1,"a":471,"b":471})"),
                      {.sync = false});
  ASSERT_TRUE(tape);
  ASSERT_TRUE(tape->event_line(tape_time_us(0), R"({"t_us":0,"event":"snow","a":471,"b":47118,"471":471})"));
  ASSERT_TRUE(tape->event_line(tape_time_us(0), R"({"t_us":0,"event":"snow","a":471,"b":18})"));
  ASSERT_TRUE(tape->finish(tape->latest()));
  const auto done = redact(
      paths, "[[redact]]\nname='x'\ntext='471'\nwith='*'\n[[redact]]\nname='y'\ntext='18'\nwith='*'\n");
  ASSERT_TRUE(done) << done.error().message;
  std::vector<std::string> left;
  for (const UnredactedText& each : done->left)
    left.push_back((each.where == TapeRedaction::Where::header ? "header " : "event ") +
                   std::string(each.what == FixedText::number ? "number " : "name ") + each.key + " rule " +
                   std::to_string(each.rule) + " x" + std::to_string(each.count));
  EXPECT_THAT(left, testing::UnorderedElementsAre("header number a rule 0 x1", "header number b rule 0 x1",
                                                  "event number a rule 0 x2", "event number b rule 0 x1",
                                                  "event number b rule 1 x2", "event number *** rule 0 x1",
                                                  "event name *** rule 0 x1"));
}

TEST_F(RedactEndsTest, OfASerialNumberOfFourLettersEachIsHiddenAndAShorterOneStays) {
  for (const std::string serial : {"PT01", "PT0"}) {
    PortIdentity identity;
    identity.path = "/dev/ttyUSB0";
    identity.serial = serial;
    const TapePaths paths =
        tape(MemoryTape().open(0).event(1, event::Mark{"of " + serial + " and " + serial}), 2,
             {.device = "serial:/dev/" + serial + "-" + serial, .driver = "pty", .identity = identity});
    const auto done = redact(paths, kRules, true);
    ASSERT_TRUE(done) << done.error().message;
    EXPECT_TRUE(done->identity_gone);
    const std::string header = TapeReader::open(made)->header_line();
    const std::string mark = test::lines_on(made).back();
    if (serial.size() == 4) {
      EXPECT_THAT(header, HasSubstr("serial:/dev/xxxx-xxxx"));
      EXPECT_THAT(mark, HasSubstr("of xxxx and xxxx"));
    } else {
      EXPECT_THAT(header, HasSubstr("serial:/dev/PT0-PT0"));
      EXPECT_THAT(mark, HasSubstr("of PT0 and PT0"));
    }
    EXPECT_THAT(header, Not(HasSubstr("identity")));
  }
}

TEST_F(RedactEndsTest, UsesAreCountedByRuleWithTheirBytesAndTheFirst) {
  const auto done =
      redact(tape(MemoryTape().write(5, "secret").read(10, "a secret, secret").read(20, "none"), 30),
             kRules + "[[redact]]\nname='other'\ntext='none'\ndir='w'\nevents=false\n");
  ASSERT_TRUE(done);
  ASSERT_EQ(done->rules.size(), 2U);
  EXPECT_EQ(done->rules[0].count, 3U);
  EXPECT_EQ(done->rules[0].bytes, 18U);
  ASSERT_TRUE(done->rules[0].first.has_value());
  EXPECT_EQ(done->rules[0].first->where, TapeRedaction::Where::read);
  EXPECT_EQ(to_us(done->rules[0].first->at), 10);
  EXPECT_EQ(done->rules[0].first->offset, 2U);
  EXPECT_EQ(done->rules[0].first->length, 6U);
  EXPECT_EQ(done->rules[1].count, 0U);
  EXPECT_FALSE(done->rules[1].first.has_value());
  EXPECT_EQ(done->follows.count, 0U);
}

TEST_F(RedactEndsTest, WhatIsHiddenIsOfTheBlockInWhichItBegins) {
  const std::vector<std::int64_t> begins = {10, 20};
  for (std::size_t block = 0; block < 2; ++block) {
    const std::string first = block == 0 ? "of secret" : "before ";
    const auto done = redact(tape(MemoryTape().read(10, first).read(20, "secret"), 30));
    ASSERT_TRUE(done);
    ASSERT_TRUE(done->rules[0].first.has_value());
    EXPECT_EQ(to_us(done->rules[0].first->at), begins[block]);
  }
}

TEST_F(RedactEndsTest, ABlockWithoutAByteStaysWhereverItIs) {
  ASSERT_TRUE(redact(
      tape(MemoryTape().read(1, "").read(2, "a sec").read(3, "").read(4, "ret").read(5, "").read(6, ""), 7)));
  EXPECT_THAT(test::lines_on(made), ElementsAre("r 1 ", "r 2 a ***", "r 3 ", "r 4 ***", "r 5 ", "r 6 "));
}

// What may be the beginning of a secret is held back, and with it all that comes behind it.
TEST_F(RedactEndsTest, AMillionBlocksWithoutAByteWaitAndOneMoreIsTooMany) {
  constexpr std::size_t most = std::size_t{1} << 20;
  const Bytes empty = test::block_bytes({{0, ""}});
  Bytes blocks = test::block_bytes({{0, "se"}});
  for (std::size_t i = 0; i + 1 < most; ++i) blocks.insert(blocks.end(), empty.begin(), empty.end());
  const TapePaths paths = literal_tape(dir / "many");
  test::write_file(paths.read, blocks);
  EXPECT_TRUE(redact(paths));
  blocks.insert(blocks.end(), empty.begin(), empty.end());
  test::write_file(paths.read, blocks);
  const auto done = redact(paths);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, Errc::usage);
  EXPECT_EQ(done.error().message, "it has more than a million blocks without a byte in a row");
}

TEST_F(RedactEndsTest, ChecksumsThatFollowAndThoseThatWereWrongAreCounted) {
  const std::string good = "$GPGLL,5057.970,N,00146.110,E,142451,A*27\r\n";
  const std::string wrong = "$GPGLL,5057.970,N,00146.110,E,142451,A*28\r\n";
  const auto done = redact(tape(MemoryTape().write(1, wrong).read(2, good + wrong + wrong), 3),
                           "[[frame]]\nprotocol='nmea'\n[[redact]]\nname='l'\ncolumn=1\nwith='0000.000'\n");
  ASSERT_TRUE(done);
  EXPECT_EQ(done->wrong_checksums, 3U);
  EXPECT_EQ(done->follows.count, 1U);
  EXPECT_EQ(done->follows.bytes, 1U);
}

}  // namespace
}  // namespace porttape
