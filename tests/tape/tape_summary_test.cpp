#include "libport/tape/tape_summary.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/quantiles.hpp"
#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using test::Block;

TapeSummary summary_of(const std::vector<Block>& read, const std::vector<Block>& write,
                       const std::string& events = "") {
  TapeSources sources{test::memory("t.logr", test::block_bytes(read)),
                      test::memory("t.logw", test::block_bytes(write)), nullptr};
  if (!events.empty()) {
    sources.events =
        test::memory("t.loge", test::bytes_of("{\"format\":\"porttape-events\",\"version\":1}\n" + events));
  }
  auto summary = summarize("t.log", std::move(sources));
  if (!summary) throw std::runtime_error(summary.error().message);
  return std::move(*summary);
}

TEST(TapeSummary, CountsBlocksBytesAndTimes) {
  const TapeSummary tape = summary_of({{10, "abc"}, {20, ""}, {30, "defg"}}, {{5, "x"}});
  EXPECT_EQ(tape.read.blocks, 3U);
  EXPECT_EQ(tape.read.bytes, 7U);
  EXPECT_EQ(tape.read.largest_block, 4U);
  EXPECT_EQ(tape.read.file_bytes, 43U);
  EXPECT_EQ(*tape.read.first, tape_time_us(10));
  EXPECT_EQ(*tape.read.last, tape_time_us(30));
  EXPECT_EQ(tape.duration(), Micros{30});
}

TEST(TapeSummary, AnExchangeIsARunOfWritesAndItsAnswer) {
  // Unasked data, a question in two writes with an answer in two reads, one without an answer, one answered
  // late.
  const TapeSummary tape =
      summary_of({{1, "boot"}, {130, "a"}, {140, "b"}, {5000, "c"}}, {{100, "q"}, {110, "q"}, {200, "q"}});
  EXPECT_EQ(tape.exchanges, 2U);
  EXPECT_EQ(tape.answered, 2U);
  EXPECT_EQ(tape.latency->min_us, 20);
  EXPECT_EQ(tape.latency->max_us, 4800);
}

TEST(TapeSummary, AnAnswerBehindAReopenIsNone) {
  const TapeSummary tape =
      summary_of({{500, "hello"}}, {{100, "q"}},
                 "{\"t_us\":200,\"event\":\"close\"}\n{\"t_us\":300,\"event\":\"open\"}\n");
  EXPECT_EQ(tape.exchanges, 1U);
  EXPECT_EQ(tape.answered, 0U);
  EXPECT_FALSE(tape.latency);
  EXPECT_EQ(tape.events.count<event::Open>(), 1U);
}

TEST(TapeSummary, TheZeroThatAnEventTellsIsInTheHeader) {
  const std::string mark = "{\"t_us\":1,\"event\":\"mark\"}\n";
  const std::string zero = R"({"t_us":2,"event":"zero","wall":"2024","monotonic_us":7,"boot":"b"})";
  const std::string later = "{\"t_us\":3,\"event\":\"mark\"}\n";
  EXPECT_FALSE(summary_of({}, {}, mark).events.header->zero);
  EXPECT_EQ(summary_of({}, {}, mark + zero + "\n" + later).events.header->zero, (TapeZero{"2024", 7, "b"}));
}

TEST(TapeSummary, GapsAreAddedUp) {
  const TapeSummary tape = summary_of(
      {}, {}, "{\"t_us\":1,\"event\":\"gap\",\"bytes\":5}\n{\"t_us\":2,\"event\":\"gap\",\"bytes\":6}\n");
  EXPECT_EQ(tape.events.count<event::Gap>(), 2U);
  EXPECT_EQ(tape.events.gap_bytes, 11U);
}

TEST(TapeSummary, APageOfZerosIsDamage) {
  const auto with_empty = [](std::size_t count) {
    return summary_of(std::vector<Block>(count, Block{0, ""}), {{20, "c"}});
  };
  const TapeSummary few = with_empty(170);
  EXPECT_FALSE(few.read.damage);
  EXPECT_EQ(few.read.blocks, 170U);
  const TapeSummary page = with_empty(341);
  ASSERT_TRUE(page.read.damage);
  EXPECT_EQ(page.read.damage->code, Errc::damaged_tape);
  EXPECT_THAT(page.read.damage->message, testing::StartsWith("t.logr: begins with zeros, as where a disk"));
  EXPECT_EQ(page.write.blocks, 1U) << "the other file is read all the same";
}

TEST(TapeSummary, DamageInOneFileDoesNotStopTheOthers) {
  const TapeSummary tape =
      summary_of({{10, "a"}, {5, "b"}}, {{20, "c"}, {30, "d"}}, "{\"t_us\":1,\"event\":\"mark\"}\nx\n");
  EXPECT_EQ(tape.write.blocks, 2U);
  EXPECT_EQ(tape.read.blocks, 1U);
  EXPECT_EQ(tape.damages().size(), 2U);
}

TEST(TapeSummary, UnknownKindsCannotFillTheMemory) {
  std::string events;
  for (int i = 0; i < 1000; ++i) events += "{\"t_us\":1,\"event\":\"kind" + std::to_string(i) + "\"}\n";
  EXPECT_EQ(summary_of({}, {}, events).events.kinds.size(), 64U);
}

TEST(Quantiles, AreExactForFewValues) {
  Quantiles values;
  EXPECT_EQ(values.at(0.5), 0);
  for (int i = 100; i >= 1; --i) values.add(i);
  EXPECT_EQ(values.min(), 1);
  EXPECT_EQ(values.at(0.5), 50);
  EXPECT_EQ(values.at(0.99), 99);
  EXPECT_EQ(values.at(1), 100);
  EXPECT_EQ(values.max(), 100);
}

TEST(Quantiles, AreWithinOnePercentForManyValues) {
  Quantiles values;
  constexpr std::int64_t kCount = 100'000;
  for (std::int64_t i = 1; i <= kCount; ++i) values.add(i * i);
  for (const double q : {0.001, 0.25, 0.5, 0.9, 0.99}) {
    const double exact = q * kCount * q * kCount;
    EXPECT_NEAR(static_cast<double>(values.at(q)), exact, exact / 100) << q;
  }
  EXPECT_EQ(values.min(), 1);
  EXPECT_EQ(values.max(), kCount * kCount);
  EXPECT_EQ(values.at(1), values.max());
  values.add(std::numeric_limits<std::int64_t>::max());
  EXPECT_EQ(values.max(), std::numeric_limits<std::int64_t>::max());
}

}  // namespace
}  // namespace porttape
