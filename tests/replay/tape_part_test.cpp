// One session of a tape, played as if it were the whole.

#include "libport/replay/tape_part.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/replay/hint.hpp"
#include "libport/replay/tape_count.hpp"
#include "tests/replay/rig.hpp"

namespace porttape {
namespace {

using test::MemorySource;
using test::MemoryTape;
using test::Rig;
using testing::HasSubstr;

MemoryTape two_sessions() {
  return MemoryTape()
      .open(0)
      .write(1'000, "one")
      .read(2'000, "first")
      .close(5'000)
      .read(6'000, "to nobody")
      .open(100'000)
      .write(101'000, "two!")
      .read(103'000, "second")
      .close(110'000);
}

std::optional<TapePart> find(const MemoryTape& tape, std::uint64_t session) {
  SessionSearch search(session);
  for (const MemoryTape::Entry& entry : tape.entries()) {
    if (entry.kind == RecordKind::open) search.on_open(tape_time_us(entry.us));
    if (entry.kind == RecordKind::close) search.on_close(tape_time_us(entry.us));
  }
  return search.found();
}

// What is left of a tape: "r@2000+0:first", by kind, time, offset and bytes.
std::string shown(RecordSource& source) {
  std::string text;
  while (true) {
    const auto next = source.next();
    if (!next || !*next) return text;
    const Record& record = **next;
    if (record.kind == RecordKind::event) continue;
    const bool block = record.kind == RecordKind::read || record.kind == RecordKind::write;
    text += record.kind == RecordKind::read    ? "r"
            : record.kind == RecordKind::write ? "w"
            : record.kind == RecordKind::open  ? "open"
                                               : "close";
    text += '@' + std::to_string(to_us(record.at));
    if (block) text += '+' + std::to_string(record.stream_offset) + ':' + std::string(as_text(record.data));
    text += ' ';
  }
}

TEST(TapePart, HasTheRecordsOfItsSessionAsIfTheyWereAll) {
  const MemoryTape tape = two_sessions();
  for (const std::size_t piece : {std::size_t{100}, std::size_t{2}}) {
    MemorySource source(tape, MemorySource::Select::merged, piece);
    PartOfTape part(source, find(tape, 2).value());
    std::size_t reads = 0;
    std::size_t writes = 0;
    while (true) {
      const auto next = part.next();
      if (!next || !*next) break;
      if ((*next)->kind == RecordKind::read) reads += (*next)->data.size();
      if ((*next)->kind == RecordKind::write) writes += (*next)->data.size();
    }
    EXPECT_EQ(reads, 6U);
    EXPECT_EQ(writes, 4U);
  }
  MemorySource source(tape);
  PartOfTape first(source, find(tape, 1).value());
  EXPECT_EQ(shown(first), "open@0 w@1000+0:one r@2000+0:first close@5000 ");
  ASSERT_TRUE(first.rewind());
  EXPECT_EQ(shown(first), "open@0 w@1000+0:one r@2000+0:first close@5000 ");
  MemorySource again(tape);
  PartOfTape second(again, find(tape, 2).value());
  EXPECT_EQ(shown(second), "open@0 w@1000+0:two! r@3000+0:second close@10000 ");
}

TEST(TapePart, OneDirectionAloneIsCutByTime) {
  const MemoryTape tape = two_sessions();
  MemorySource source(tape, MemorySource::Select::writes_only);
  PartOfTape part(source, find(tape, 2).value());
  EXPECT_EQ(shown(part), "w@1000+0:two! ");
}

TEST(TapePart, WhatPrecedesItHasItsBytesStillSoThatABudgetSeesThem) {
  const MemoryTape tape = two_sessions();
  MemorySource source(tape);
  PartOfTape part(source, find(tape, 2).value());
  std::size_t before = 0;
  for (auto next = part.next(); next && *next && (*next)->kind != RecordKind::open; next = part.next()) {
    EXPECT_EQ((*next)->kind, RecordKind::event);
    before += (*next)->data.size();
  }
  EXPECT_EQ(before, 3U + 5U + 9U);
}

TEST(TapePart, ASessionWithoutACloseEndsWithTheNextOpenOrTheTape) {
  const MemoryTape tape =
      MemoryTape().open(0).write(5, "a").open(10).write(15, "b").open(10'000).read(10'001, "c");
  MemorySource source(tape);
  PartOfTape second(source, find(tape, 2).value());
  EXPECT_EQ(shown(second), "open@0 w@5+0:b ");
  MemorySource again(tape);
  PartOfTape third(again, find(tape, 3).value());
  EXPECT_EQ(shown(third), "open@0 r@1+0:c ");
}

TEST(TapePart, SessionsOfOneMomentAreToldApart) {
  const MemoryTape tape = MemoryTape().open(10).close(10).open(10).write(11, "b").close(12);
  MemorySource source(tape);
  PartOfTape first(source, find(tape, 1).value());
  EXPECT_EQ(shown(first), "open@0 close@0 ");
  MemorySource again(tape);
  PartOfTape second(again, find(tape, 2).value());
  EXPECT_EQ(shown(second), "open@0 w@1+0:b close@2 ");
}

TEST(TapePart, TheWholeTapeIsAllOfItsSessions) {
  const MemoryTape tape = MemoryTape().open(0).write(5, "a").close(7).open(10).write(15, "b").close(20);
  MemorySource source(tape);
  PartOfTape whole(source, TapePart{});
  EXPECT_EQ(shown(whole), "open@0 w@5+0:a close@7 open@10 w@15+1:b close@20 ");
}

TEST(TapePart, ThereAreNoMoreSessionsThanOpens) {
  EXPECT_FALSE(find(two_sessions(), 3).has_value());
  const MemoryTape plain = MemoryTape().write(5, "a");
  EXPECT_TRUE(find(plain, 1)->whole()) << "a tape without opens is one session";
  EXPECT_FALSE(find(plain, 2).has_value());
}

class PlayedPart : public testing::Test {
 protected:
  PlayedPart() { engine.on_open(Instant{}); }

  MemoryTape tape = two_sessions();
  TapePart part = find(tape, 2).value();
  MemorySource merged{tape};
  MemorySource writes{tape, MemorySource::Select::writes_only};
  PartOfTape schedule{merged, part};
  PartOfTape expected{writes, part};
  Engine engine{{}, {.stamped_at_arrival = true, .opens = 1}, schedule, expected};
};

TEST_F(PlayedPart, IsTimedFromItsOpenAndCountedByItself) {
  const auto at = [](std::int64_t us) { return Instant{Nanos{us * 1000}}; };
  engine.on_write(at(1'000), as_bytes("two!"));
  EXPECT_TRUE(engine.advance(at(2'999)).deliver.empty());
  EXPECT_EQ(as_text(engine.advance(at(3'000)).deliver), "second");
  engine.on_close(at(4'000));
  const std::optional<RunReport> report = engine.advance(at(4'000)).run_ended;
  ASSERT_TRUE(report.has_value());
  EXPECT_EQ(report->verdict, Verdict::pass);
  EXPECT_EQ(report->from_driver_matched, 4U);
  EXPECT_EQ(report->sessions_of, 1U);
}

TEST_F(PlayedPart, AMismatchIsAtItsOwnOffset) {
  const ReplayActions actions = [&] {
    engine.on_write(Instant{}, as_bytes("twx!"));
    return engine.advance(Instant{});
  }();
  ASSERT_EQ(actions.mismatches.size(), 1U);
  EXPECT_EQ(actions.mismatches.front().tape_offset, 2U);
  EXPECT_EQ(actions.mismatches.front().tape, tape_time_us(1'000));
  EXPECT_EQ(actions.mismatches.front().exchange, 1U);
}

TEST_F(PlayedPart, IsCountedAndSearchedByItself) {
  ASSERT_TRUE(schedule.rewind());
  EXPECT_EQ(count_tape(schedule), (TapeTotals{6, 4}));
  EXPECT_EQ(find_hint(expected, 0, as_bytes("o!")).value(), "comes later at offset 2 (tape 0.001000 s)");
  EXPECT_EQ(find_hint(expected, 0, as_bytes("one")).value(), "") << "which another session has";
}

TEST(Sessions, FewerThanTheTapeHasAreTold) {
  Rig rig(two_sessions());
  rig.open().write("one").wait(3'000).close();
  EXPECT_EQ(rig.finish(), Verdict::incomplete);
  EXPECT_EQ(rig.report->sessions_made, 1U);
  EXPECT_EQ(rig.report->sessions_of, 2U);
  EXPECT_THAT(to_text(*rig.report), HasSubstr("\n  the tape has two sessions, the driver made one\n"));
  EXPECT_THAT(to_json(*rig.report), HasSubstr(R"("sessions":{"made":1,"of":2})"));
}

TEST(Sessions, AsManyAsTheTapeHasAreNotTold) {
  Rig rig(two_sessions());
  rig.open().close();  // a look: the session begins anew
  rig.open().write("one").wait(3'000).close();
  rig.open().write("two!").wait(3'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->sessions_made, 2U);
  EXPECT_EQ(to_text(*rig.report).find("session"), std::string::npos);
}

TEST(Sessions, OneThatIsLongerThanRecordedMakesNoSecond) {
  Rig rig(two_sessions());
  rig.open().write("one").wait(3'000).write("two!").wait(3'000).close();
  EXPECT_EQ(rig.verdict(), Verdict::pass);
  EXPECT_EQ(rig.report->sessions_made, 1U);
  EXPECT_THAT(to_text(*rig.report), HasSubstr("the driver made one"));
}

}  // namespace
}  // namespace porttape
