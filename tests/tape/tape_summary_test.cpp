#include "libport/tape/tape_summary.hpp"

#include <cstdint>
#include <map>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/event.hpp"
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

TEST(TapeSummary, TellsTheLayoutOfTheFiles) {
  EXPECT_EQ(summary_of({{1, "a"}}, {}).layout, Layout::big_endian);
  auto native = summarize("t.log", {test::memory("t.logr", test::block_bytes({{10, "abc"}}, true)),
                                    test::memory("t.logw", {}), nullptr});
  ASSERT_TRUE(native);
  EXPECT_EQ(native->layout, Layout::native64);
  EXPECT_EQ(native->read.bytes, 3U);
}

TEST(TapeSummary, AFileThatDoesNotExistHasItsPathAllTheSame) {
  auto tape = summarize("t.log", {test::memory("other", test::block_bytes({{10, "abc"}})), nullptr, nullptr});
  ASSERT_TRUE(tape);
  EXPECT_TRUE(tape->read.exists);
  EXPECT_EQ(tape->read.path, "other") << "the one that was read";
  EXPECT_FALSE(tape->write.exists);
  EXPECT_EQ(tape->write.path, "t.logw");
  EXPECT_EQ(tape->write.blocks, 0U);
  EXPECT_FALSE(tape->write.last);
  EXPECT_FALSE(tape->events.exists);
  EXPECT_EQ(tape->events.path, "t.loge");
}

std::string noted(std::int64_t us, const Event& event) { return encode(tape_time_us(us), event); }

TEST(TapeSummary, OfEachListTheFirst64AreKeptAndAllAreCounted) {
  std::string events;
  for (int i = 1; i <= 66; ++i) {
    const std::string text = std::to_string(i);
    events += noted(i, event::Gap{1, tape_time_us(i - 1), text});
    events += noted(i, event::Mark{text});
    events += noted(i, event::Settings{});
    events += noted(i, event::Break{true, Side::device});
    events += noted(i, event::Fault{{.kind = "drop", .offset = i}});
  }
  const EventsSummary told = summary_of({}, {}, events).events;
  ASSERT_EQ(told.gaps.size(), 64U);
  EXPECT_EQ(told.gaps.back().from, tape_time_us(63));
  EXPECT_EQ(told.gaps.back().at, tape_time_us(64));
  EXPECT_EQ(told.gaps.back().why.raw(), "64");
  ASSERT_EQ(told.marks.size(), 64U);
  EXPECT_EQ(told.marks.back().text.raw(), "64");
  ASSERT_EQ(told.settings.size(), 64U);
  EXPECT_EQ(told.settings.back().at, tape_time_us(64));
  ASSERT_EQ(told.signals.size(), 64U);
  EXPECT_EQ(told.signals.back().at, tape_time_us(64));
  ASSERT_EQ(told.faults.size(), 64U);
  EXPECT_EQ(told.faults.back().what.fault.offset, 64U);
  EXPECT_EQ(told.gap_bytes, 66U);
  EXPECT_EQ(told.count<event::Gap>(), 66U);
  EXPECT_EQ(told.count<event::Mark>(), 66U);
  EXPECT_EQ(told.count<event::Settings>(), 66U);
  EXPECT_EQ(told.fault_kinds, (std::map<StrangerText, std::uint64_t>{{"drop", 66}}));
}

TEST(TapeSummary, APlanIsNoFaultAndThoseThatWereNotToldSinglyCountToo) {
  const EventsSummary told =
      summary_of({}, {},
                 noted(1, event::Fault{{.kind = "plan", .spec = "drop:p=1", .seed = 0}}) +
                     noted(2, event::Fault{{.kind = "drop", .offset = 1}}) +
                     noted(3, event::Fault{{.kind = "more", .count = 9}}) +
                     noted(4, event::Fault{{.kind = "drop", .offset = 3}}))
          .events;
  EXPECT_EQ(told.faults.size(), 4U);
  EXPECT_EQ(told.fault_kinds, (std::map<StrangerText, std::uint64_t>{{"drop", 2}, {"more", 9}}));
}

TEST(TapeSummary, AFloodOfKindsHidesNoneThatWasThereBefore) {
  std::string events = noted(0, event::Mark{"one"});
  for (int i = 0; i < 100; ++i) {
    events += noted(1, event::Fault{{.kind = "kind" + std::to_string(i)}});
    events += "{\"t_us\":1,\"event\":\"kind" + std::to_string(i) + "\"}\n";
  }
  events += noted(2, event::Mark{"two"}) + noted(2, event::Fault{{.kind = "kind0"}});
  const EventsSummary told = summary_of({}, {}, events).events;
  EXPECT_EQ(told.count<event::Mark>(), 2U);
  EXPECT_EQ(told.count<event::Fault>(), 101U);
  EXPECT_EQ(told.fault_kinds.size(), 64U);
  EXPECT_EQ(told.fault_kinds.at("kind0"), 2U);
}

TEST(TapeSummary, ASessionIsFromAnOpenToItsCloseAndBytesBetweenBelongToNone) {
  const TapeSummary tape = summary_of({{15, "abc"}, {25, "lost"}, {45, "de"}}, {{12, "q"}, {60, "qqqq"}},
                                      noted(10, event::Open{}) + noted(20, event::Close{}) +
                                          noted(30, event::Open{}) + noted(50, event::Open{}));
  EXPECT_EQ(tape.session_count, 3U);
  ASSERT_EQ(tape.sessions.size(), 3U);
  const SessionSummary& closed = tape.sessions[0];
  EXPECT_EQ(closed.opened, tape_time_us(10));
  EXPECT_EQ(closed.closed, tape_time_us(20));
  EXPECT_EQ(closed.duration, Micros{10});
  EXPECT_EQ(closed.read_bytes, 3U);
  EXPECT_EQ(closed.write_bytes, 1U);
  const SessionSummary& reopened = tape.sessions[1];
  EXPECT_EQ(reopened.opened, tape_time_us(30));
  EXPECT_FALSE(reopened.closed) << "the next open came without a close";
  EXPECT_EQ(reopened.duration, Micros{20});
  EXPECT_EQ(reopened.read_bytes, 2U);
  EXPECT_EQ(reopened.write_bytes, 0U);
  const SessionSummary& left_open = tape.sessions[2];
  EXPECT_FALSE(left_open.closed);
  EXPECT_EQ(left_open.duration, Micros{10}) << "to the tape's end";
  EXPECT_EQ(left_open.write_bytes, 4U);
}

TEST(TapeSummary, ATapeWithoutOpensIsOneSessionUnlessItIsEmpty) {
  EXPECT_EQ(summary_of({}, {}).session_count, 0U);
  for (const TapeSummary& tape : {summary_of({{7, "a"}}, {}), summary_of({}, {{7, "a"}})}) {
    EXPECT_EQ(tape.session_count, 1U);
    ASSERT_EQ(tape.sessions.size(), 1U);
    EXPECT_FALSE(tape.sessions[0].opened);
    EXPECT_EQ(tape.sessions[0].duration, Micros{7});
    EXPECT_EQ(tape.sessions[0].read_bytes + tape.sessions[0].write_bytes, 1U);
  }
}

TEST(TapeSummary, TheFirstThousandSessionsAreKeptAndAllAreCounted) {
  std::string events;
  for (int i = 1; i <= 1002; ++i) events += noted(i, event::Open{});
  const TapeSummary tape = summary_of({}, {}, events);
  EXPECT_EQ(tape.session_count, 1002U);
  ASSERT_EQ(tape.sessions.size(), 1000U);
  EXPECT_EQ(tape.sessions.back().opened, tape_time_us(1000));
}

TEST(TapeSummary, AnEndIsTheLastEventAndTellsOfBothFilesOrOfNone) {
  const PayloadTotals one{1, 3, {}, {}};
  const PayloadTotals none{};
  const auto told = [](const std::string& lines) { return summary_of({}, {}, lines).events; };
  const EventsSummary both = told(noted(5, event::End{.read = one, .write = none}));
  EXPECT_TRUE(both.ended);
  EXPECT_EQ(both.end_read, one);
  EXPECT_EQ(both.end_write, none);
  EXPECT_EQ(both.last, tape_time_us(5));
  for (const event::End& half :
       {event::End{.read = one, .write = {}}, event::End{.read = {}, .write = one}, event::End{}}) {
    const EventsSummary end = told(noted(5, half));
    EXPECT_TRUE(end.ended);
    EXPECT_FALSE(end.end_read);
    EXPECT_FALSE(end.end_write);
    EXPECT_FALSE(end.covers_lines);
  }
  const EventsSummary went_on =
      told(noted(5, event::End{.read = one, .write = none}) + noted(6, event::Mark{"m"}));
  EXPECT_FALSE(went_on.ended);
  EXPECT_FALSE(went_on.end_read);
  EXPECT_EQ(went_on.last, tape_time_us(6));
}

TEST(TapeSummary, TheLastEventMayBeWhatTheTapeIsAsLongAs) {
  EXPECT_EQ(summary_of({{10, "a"}}, {{20, "b"}}, noted(30, event::Mark{"m"})).duration(), Micros{30});
  EXPECT_EQ(summary_of({{10, "a"}}, {{20, "b"}}).duration(), Micros{20});
  EXPECT_EQ(summary_of({}, {}).duration(), Micros{0});
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
