#include "libport/taped/tape_stats.hpp"

#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/rules/framing.hpp"
#include "libport/tape/tape_reader.hpp"
#include "libport/tape/tape_summary.hpp"
#include "tests/support/memory_tape.hpp"
#include "tests/support/random_tape.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using std::chrono::milliseconds;
using test::MemoryTape;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::SizeIs;

TapeStats stats_of_tape(const MemoryTape& tape, const TapeStatsOptions& options = {}) {
  test::MemorySource source(tape);
  const auto stats = count_stats(source, options);
  EXPECT_TRUE(stats);
  return stats ? *stats : TapeStats{};
}

std::vector<std::string> rows(const std::vector<CommandStats>& commands) {
  std::vector<std::string> all;
  for (const CommandStats& each : commands)
    all.push_back(each.command + " " + std::to_string(each.count) + " " + std::to_string(each.bytes) + " " +
                  std::to_string(each.unanswered) + " " + std::to_string(each.spans.max_us));
  return all;
}

MemoryTape asked() {
  return MemoryTape()
      .open(0)
      .write(1'000'000, "VOLT?\n")
      .read(1'002'000, "5\n")
      .write(2'000'000, "VO")
      .write(2'000'100, "LT?\n")
      .read(2'050'100, "6")
      .read(2'060'000, "\n")
      .write(9'000'000, "RESET\n")
      .close(9'500'000)
      .open(20'000'000)
      .write(20'000'010, "VOLT?\n")
      .read(20'001'010, "7\n");
}

TEST(TapeStatsTest, ExchangesAreToldApartByTheirWrites) {
  std::vector<TapeExchange> exchanges;
  TapeStatsOptions options;
  options.on_exchange = [&](const TapeExchange& each) { exchanges.push_back(each); };
  const TapeStats stats = stats_of_tape(asked(), options);
  EXPECT_EQ(stats.exchanges, 4U);
  EXPECT_EQ(stats.answered, 3U);
  EXPECT_EQ(stats.answers.max_us, 50'000);
  EXPECT_THAT(rows(stats.write.commands), ElementsAre("VOLT 3 18 0 50000", "RESET 1 6 1 0"));
  EXPECT_THAT(stats.read.commands, IsEmpty());
  ASSERT_THAT(exchanges, SizeIs(4));
  EXPECT_EQ(exchanges[1].number, 2U);
  EXPECT_EQ(exchanges[1].answer, Micros(50'000));
  EXPECT_EQ(exchanges[1].written, 6U);
  EXPECT_EQ(exchanges[1].read, 2U);
  EXPECT_EQ(exchanges[1].until, tape_time_us(2'060'000));
  EXPECT_EQ(exchanges[2].answer, std::nullopt);
  ASSERT_THAT(stats.slowest, SizeIs(3));
  EXPECT_EQ(stats.slowest[0].number, 2U);
}

TEST(TapeStatsTest, TheMostFrequentCommandsAreFirstAndEqualOnesByName) {
  MemoryTape tape;
  std::int64_t us = 0;
  for (const char* const command : {"MOVE", "STOP", "HALT", "VOLT", "BEEP", "STOP", "VOLT", "STOP"}) {
    tape.write(us, std::string(command) + "\n").read(us + 500, "ok\n");
    us += 1'000;
  }
  std::vector<std::string> names;
  for (const CommandStats& each : stats_of_tape(tape).write.commands) names.push_back(each.command);
  EXPECT_THAT(names, ElementsAre("STOP", "VOLT", "BEEP", "HALT", "MOVE"));
}

TEST(TapeStatsTest, SilenceIsOfAnOpenLine) {
  const TapeStats stats = stats_of_tape(asked());
  ASSERT_EQ(stats.silences, 2U);  // not while it was closed
  EXPECT_EQ(stats.longest_silences[0].from, tape_time_us(2'060'000));
  EXPECT_EQ(stats.longest_silences[0].length, Micros(6'940'000));
  EXPECT_EQ(stats.longest_silences[1].length, Micros(1'000'000));
  EXPECT_EQ(stats.silent, Micros(7'940'000));
  TapeStatsOptions options;
  options.most = 1;
  EXPECT_THAT(stats_of_tape(asked(), options).longest_silences, SizeIs(1));
}

TEST(TapeStatsTest, TheBusiestSecondOfADirection) {
  const TapeStats stats = stats_of_tape(
      MemoryTape().read(100, "a").read(5'900'000, "bcd").read(6'000'000, "ef").read(6'100'000, "gh"));
  EXPECT_EQ(stats.read.busiest_bytes, 4U);
  EXPECT_EQ(stats.read.busiest, tape_time_us(6'000'000));
}

TEST(TapeStatsTest, OfSecondsThatAreAsBusyTheFirstIsTold) {
  const TapeStats stats = stats_of_tape(MemoryTape().read(1'999'999, "ab").read(2'000'000, "cd"));
  EXPECT_EQ(stats.read.busiest_bytes, 2U);
  EXPECT_EQ(stats.read.busiest, tape_time_us(1'000'000));
}

TEST(TapeStatsTest, FramesOfBothSides) {
  TapeStatsOptions options;
  options.formats = protocol_formats("nmea");
  const TapeStats stats = stats_of_tape(MemoryTape()
                                            .read(0, "x$GPGGA,1*00\r\n$GPRMC,")
                                            .read(10, "2*00\r\n")
                                            .write(500'000, "$PMTK000*32\r\n")
                                            .read(1'000'000, "$GPGGA,2*00\r\n"),
                                        options);
  EXPECT_EQ(stats.read.stray, 1U);
  EXPECT_THAT(rows(stats.read.commands), ElementsAre("GPGGA 2 26 0 1000000", "GPRMC 1 13 0 0"));
  EXPECT_THAT(rows(stats.write.commands), ElementsAre("PMTK000 1 13 0 500000"));
}

TEST(TapeStatsTest, AFrameThatIsSentAgainWasUnanswered) {
  TapeStatsOptions options;
  options.formats = protocol_formats("nmea");
  const TapeStats stats = stats_of_tape(MemoryTape()
                                            .write(0, "$PMTK000*32\r\n")
                                            .write(1'000'000, "$PMTK000*32\r\n$PMTK1")
                                            .write(1'000'100, "01*32\r\n")
                                            .read(1'000'200, "$GPGGA,2*00\r\n")
                                            .write(2'000'000, "$PMTK101*32\r\n")
                                            .close(3'000'000)
                                            .open(4'000'000)
                                            .write(4'000'100, "$PMTK000*32\r\n"),
                                        options);
  EXPECT_EQ(stats.exchanges, 3U);
  EXPECT_THAT(rows(stats.write.commands), ElementsAre("PMTK000 3 39 3 0", "PMTK101 2 26 1 100"));
}

TEST(TapeStatsTest, FramesThatAPauseEnds) {
  using namespace std::string_literals;
  TapeStatsOptions options;
  options.formats = protocol_formats("modbus-rtu");
  const std::string three = "\x01\x03\x00\x00\x00\x01\x84\x0a"s;
  const std::string six = "\x02\x06\x00\x00\x00\x01\x48\x39"s;
  const TapeStats stats = stats_of_tape(MemoryTape()
                                            .write(0, three)
                                            .write(10'000, six.substr(0, 3))
                                            .write(10'500, six.substr(3))
                                            .read(20'000, six)
                                            .write(40'000, three),
                                        options);
  EXPECT_THAT(rows(stats.write.commands),
              ElementsAre("unit 1 function 3 2 16 2 0", "unit 2 function 6 1 8 0 9500"));
  EXPECT_THAT(rows(stats.read.commands), ElementsAre("unit 2 function 6 1 8 0 0"));
}

TEST(TapeStatsTest, AnyNumberOfCommandsInBoundedMemory) {
  MemoryTape tape;
  for (int i = 0; i < 3000; ++i) {
    std::string command = "C" + std::to_string(i);
    tape.write(i * 10, command + "\n").read(i * 10 + 5, "ok\n");
  }
  const TapeStats stats = stats_of_tape(tape);
  EXPECT_THAT(stats.write.commands, SizeIs(kMaxCommands + 1));
  EXPECT_EQ(stats.write.commands.front().command, kOtherCommands);
  EXPECT_EQ(stats.write.commands.front().count, 3000U - kMaxCommands);
}

TEST(TapeStatsTest, ACommandThatIsKnownIsCountedAsItselfThoughThereIsRoomForNoOther) {
  MemoryTape tape;
  for (std::size_t i = 0; i <= kMaxCommands; ++i) {
    const auto at = static_cast<std::int64_t>(i) * 10;
    tape.write(at, "C" + std::to_string(i % kMaxCommands) + "\n").read(at + 5, "ok\n");
  }
  const TapeStats stats = stats_of_tape(tape);
  EXPECT_THAT(stats.write.commands, SizeIs(kMaxCommands));
  EXPECT_EQ(stats.write.commands.front().command, "C0");
  EXPECT_EQ(stats.write.commands.front().count, 2U);
}

TEST(TapeStatsTest, ExchangesWithoutALetterBehindTheirFirst64BytesAreToldApartByThese) {
  std::string command(63, ' ');
  command += "ABC\n";
  const TapeStats stats = stats_of_tape(MemoryTape()
                                            .write(0, command.substr(0, 10))
                                            .write(1, command.substr(10))
                                            .read(2, "ok")
                                            .write(3, std::string(64, ' ') + "ABC"));
  EXPECT_THAT(rows(stats.write.commands), ElementsAre("(empty) 1 67 1 0", "A 1 67 0 1"));
}

TEST(TapeStatsTest, AnswersAreByTheirShares) {
  MemoryTape tape;
  for (int i = 1; i <= 100; ++i) tape.write(i * 1000, "a").read(i * 1000 + i, "b");
  const SpanStats answers = stats_of_tape(tape).answers;
  EXPECT_EQ(answers.count, 100U);
  EXPECT_EQ(answers.min_us, 1);
  EXPECT_EQ(answers.median_us, 50);
  EXPECT_EQ(answers.p90_us, 90);
  EXPECT_EQ(answers.p99_us, 99);
  EXPECT_EQ(answers.max_us, 100);
}

TEST(TapeStatsTest, OfExchangesTheSlowestAreKeptTheSlowestFirst) {
  MemoryTape tape;
  for (const int took : {3, 9, 1, 9, 5, 7}) {
    const std::int64_t at = static_cast<std::int64_t>(tape.entries().size()) * 1000;
    tape.write(at, "a").read(at + took, "b");
  }
  TapeStatsOptions options;
  for (const std::size_t most : {0U, 1U, 3U, 6U}) {
    options.most = most;
    const TapeStats stats = stats_of_tape(tape, options);
    std::vector<std::uint64_t> numbers;
    for (const TapeExchange& each : stats.slowest) numbers.push_back(each.number);
    const std::vector<std::uint64_t> all = {2, 4, 6, 5, 1, 3};
    EXPECT_EQ(numbers, std::vector(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(most)));
  }
}

TEST(TapeStatsTest, TheLongestSpanOfACommandIsTheFirstSoLong) {
  const TapeStats stats = stats_of_tape(MemoryTape()
                                            .write(0, "a")
                                            .read(5, "x")
                                            .write(100, "a")
                                            .read(109, "x")
                                            .write(200, "a")
                                            .read(209, "x")
                                            .write(300, "b"));
  ASSERT_THAT(stats.write.commands, SizeIs(2));
  EXPECT_EQ(stats.write.commands[0].longest, tape_time_us(100));
  EXPECT_EQ(stats.write.commands[0].spans.count, 3U);
  EXPECT_EQ(stats.write.commands[1].longest, std::nullopt);
}

TEST(TapeStatsTest, CommandsThatAreAsFrequentAreInOrderOfTheirNames) {
  const TapeStats stats = stats_of_tape(MemoryTape().write(0, "b").read(1, "x").write(2, "a").read(3, "x"));
  EXPECT_THAT(rows(stats.write.commands), ElementsAre("a 1 1 0 1", "b 1 1 0 1"));
}

TEST(TapeStatsTest, ABlockInPiecesIsOneBlockAndOneExchange) {
  const MemoryTape tape = MemoryTape().write(0, "VOLT?").read(10, "12345").read(2'000'000, "6");
  test::MemorySource source(tape, test::MemorySource::Select::merged, 2);
  TapeStatsOptions options;
  std::vector<std::uint64_t> progress;
  options.progress = [&](std::uint64_t bytes) { progress.push_back(bytes); };
  const auto stats = count_stats(source, options);
  ASSERT_TRUE(stats);
  EXPECT_EQ(stats->write.blocks, 1U);
  EXPECT_EQ(stats->write.bytes, 5U);
  EXPECT_EQ(stats->read.blocks, 2U);
  EXPECT_EQ(stats->read.bytes, 6U);
  EXPECT_EQ(stats->exchanges, 1U);
  EXPECT_EQ(stats->answered, 1U);
  EXPECT_EQ(stats->duration, Micros(2'000'000));
  EXPECT_EQ(stats->read.busiest_bytes, 5U);
  EXPECT_EQ(stats->read.busiest, TapeTime{});
  EXPECT_THAT(rows(stats->write.commands), ElementsAre("VOLT 1 5 0 10"));
  EXPECT_THAT(progress, ElementsAre(2, 4, 5, 7, 9, 10, 11));
}

TEST(TapeStatsTest, AnErrorOfTheTapeIsItsOwn) {
  const MemoryTape tape = MemoryTape().write(0, "a").read(1, "b");
  test::MemorySource source(tape);
  source.fail_at(1);
  const auto stats = count_stats(source, {});
  ASSERT_FALSE(stats);
  EXPECT_EQ(stats.error().code, Errc::damaged_tape);
}

TEST(TapeStatsTest, AHangUpEndsAnExchangeAndTheSilence) {
  const TapeStats stats = stats_of_tape(
      MemoryTape().open(0).write(10, "a").hang_up(20).open(3'000'000).read(3'999'999, "x").close(9'000'000));
  EXPECT_EQ(stats.exchanges, 1U);
  EXPECT_EQ(stats.answered, 0U);
  EXPECT_EQ(stats.silences, 0U);
  EXPECT_EQ(stats.duration, Micros(9'000'000));
  EXPECT_THAT(rows(stats.write.commands), ElementsAre("a 1 1 1 0"));
}

MemoryTape random(unsigned seed) {
  std::mt19937 engine(seed);
  return test::random_tape([&](std::uint32_t n) { return static_cast<std::uint32_t>(engine() % n); },
                           {.sessions = true, .hang_ups = true, .gaps = true});
}

TEST(TapeStatsTest, CountsAsInfoDoes) {
  const test::TempDir dir;
  for (unsigned seed = 0; seed < 30; ++seed) {
    const TapePaths paths = test::write_tape(literal_tape(dir / ("r" + std::to_string(seed))), random(seed));
    const auto summary = summarize(paths);
    auto reader = TapeReader::open(paths);
    ASSERT_TRUE(summary && reader);
    const auto stats = count_stats(*reader, {});
    ASSERT_TRUE(stats);
    EXPECT_EQ(stats->exchanges, summary->exchanges);
    EXPECT_EQ(stats->answered, summary->answered);
    EXPECT_EQ(stats->read.bytes, summary->read.bytes);
    EXPECT_EQ(stats->write.blocks, summary->write.blocks);
    if (summary->latency) {
      EXPECT_EQ(stats->answers.p99_us, summary->latency->p99_us);
    }
  }
}

}  // namespace
}  // namespace porttape
