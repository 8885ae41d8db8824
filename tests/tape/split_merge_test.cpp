#include <algorithm>
#include <filesystem>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/event_file.hpp"
#include "libport/tape/merge_tapes.hpp"
#include "libport/tape/split_tape.hpp"
#include "tests/support/random_tape.hpp"
#include "tests/support/tape_on_disk.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using test::MemoryTape;
using testing::ElementsAre;
using testing::HasSubstr;
using At = SplitOptions::At;

std::vector<std::string> records_of(const TapePaths& tape) {
  auto reader = TapeReader::open(tape);
  return reader ? test::read_all(*reader) : std::vector<std::string>{reader.error().message};
}

TapeZero zero_at(std::int64_t us, const std::string& boot = "boot") {
  return later(TapeZero{"2024-05-06T07:08:09.000000Z", 5'000'000, boot}, Micros(us));
}

class SplitMergeTest : public testing::Test {
 protected:
  TapePaths tape(const std::string& name, const MemoryTape& records, std::optional<TapeZero> zero = {}) {
    return test::write_tape(literal_tape(dir / name), records, {.device = name, .driver = "p", .zero = zero});
  }
  Result<std::vector<SplitPart>> split(const TapePaths& source, At at, std::int64_t us = 0) {
    parts = literal_tape(dir / ("part" + std::to_string(++made_)));
    return split_tape(source, parts,
                      {.at = at, .span = Micros(us), .writer = {.sync = false}, .progress = {}});
  }
  Result<MergedTape> merge(const std::vector<TapePaths>& tapes, std::vector<Micros> offsets = {}) {
    merged = literal_tape(dir / ("merged" + std::to_string(++made_)));
    return merge_tapes(tapes, merged,
                       {.offsets = std::move(offsets), .writer = {.sync = false}, .progress = {}});
  }
  [[nodiscard]] std::vector<TapePaths> part_list(std::size_t count) const {
    std::vector<TapePaths> all;
    for (std::size_t i = 1; i <= count; ++i) all.push_back(part_tape(parts, i));
    return all;
  }

  test::TempDir dir;
  TapePaths parts;
  TapePaths merged;

 private:
  int made_ = 0;
};

TEST_F(SplitMergeTest, EachPartIsToldWithItsTimesItsBlocksAndItsEvents) {
  const TapePaths source = tape(
      "source", MemoryTape().open(0).write(10, "a").read(20, "b").close(30).open(40).read(50, "c").close(60));
  const auto made = split(source, At::session);
  ASSERT_TRUE(made.has_value());
  ASSERT_EQ(made->size(), 2U);
  const SplitPart& first = made->front();
  const SplitPart& second = made->back();
  EXPECT_EQ(first.blocks, 2U);
  EXPECT_EQ(first.events, 2U);
  EXPECT_EQ(to_us(first.from), 0);
  EXPECT_EQ(to_us(first.to), 30);
  EXPECT_EQ(second.blocks, 1U);
  EXPECT_EQ(second.events, 2U);
  EXPECT_EQ(to_us(second.from), 40);
  EXPECT_EQ(to_us(second.to), 60);
}

TEST_F(SplitMergeTest, ByItsSessionsEachWithItsOwnZero) {
  const TapePaths source = tape("t",
                                MemoryTape()
                                    .event(5, event::Settings{Side::device, {.baud = 9600}, {}})
                                    .open(10)
                                    .write(20, "a")
                                    .close(30)
                                    .event(35, event::Mark{"between"})
                                    .open(1040)
                                    .read(1050, "b")
                                    .close(1060),
                                zero_at(0));
  const auto done = split(source, At::session);
  ASSERT_TRUE(done);
  ASSERT_EQ(done->size(), 2U);
  EXPECT_THAT(records_of(part_tape(parts, 1)),
              ElementsAre("settings 5", "open 10", "w 20 a", "close 30", "mark 35", "end 35"));
  EXPECT_THAT(records_of(part_tape(parts, 2)),
              ElementsAre("settings 0", "open 0", "r 10 b", "close 20", "end 20"));
  const auto first = header_of(part_tape(parts, 1));
  const auto second = header_of(part_tape(parts, 2));
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->zero, zero_at(0));
  EXPECT_EQ(second->zero, zero_at(1040));
  EXPECT_EQ(second->previous, (PreviousTape{first->id, part_tape(parts, 1).file_name()}));
  EXPECT_EQ(second->origin->from, Micros(1040));
}

TEST_F(SplitMergeTest, AtMarksTimesAndSilences) {
  const TapePaths source = tape("t", MemoryTape()
                                         .open(0)
                                         .write(100, "a")
                                         .event(150, event::Mark{"here"})
                                         .read(250, "b")
                                         .read(2'000, "c")
                                         .close(2'010));
  ASSERT_TRUE(split(source, At::mark));
  EXPECT_THAT(records_of(part_tape(parts, 2)),
              ElementsAre("open 0", "mark 0", "r 100 b", "r 1850 c", "close 1860", "end 1860"));
  const auto every = split(source, At::every, 200);
  ASSERT_TRUE(every);
  ASSERT_EQ(every->size(), 3U);
  EXPECT_THAT(records_of(part_tape(parts, 2)), ElementsAre("open 0", "r 50 b", "end 51"));
  EXPECT_THAT(records_of(part_tape(parts, 3)), ElementsAre("open 0", "r 0 c", "close 10", "end 10"));
  const auto gap = split(source, At::gap, 1'000);
  ASSERT_TRUE(gap);
  ASSERT_EQ(gap->size(), 2U);
  EXPECT_EQ(to_us(gap->back().from), 2'000);
}

TEST_F(SplitMergeTest, DamageLeavesNoPart) {
  const TapePaths source = tape("t", MemoryTape().open(0).write(1, "a").close(2).open(3).write(4, "b"));
  Bytes bytes = test::read_file(source.write);
  bytes.at(13 + 4) = 0xff;
  test::write_file(source.write, bytes);
  EXPECT_FALSE(split(source, At::session));
  EXPECT_FALSE(std::filesystem::exists(part_tape(parts, 1).read));
  const TapePaths empty = tape("u", MemoryTape());
  EXPECT_THAT(split(empty, At::session).error().message, HasSubstr("'u' is empty"));
}

TEST_F(SplitMergeTest, EarlierPartsAreReplacedByAllOrStay) {
  const auto files = [&] {
    std::vector<std::string> names;
    for (const auto& each : std::filesystem::directory_iterator(dir.path()))
      names.push_back(each.path().filename().string());
    std::sort(names.begin(), names.end());
    return names;
  };
  const SplitOptions options{.at = At::session,
                             .span = {},
                             .writer = {.on_existing = OnExisting::overwrite, .sync = false},
                             .progress = {}};
  const TapePaths source = tape("t", MemoryTape().open(0).write(1, "a").close(2).open(3).write(4, "b"));
  const TapePaths to = literal_tape(dir / "p.log");
  ASSERT_TRUE(split_tape(source, to, options));
  const auto before = files();
  const StrangerText id = header_of(part_tape(to, 1))->id;
  const TapePaths other = tape("u", MemoryTape().open(0).write(1, "c").close(2).open(3).write(4, "d"));
  ASSERT_TRUE(split_tape(other, to, options));
  EXPECT_NE(header_of(part_tape(to, 1))->id, id);
  EXPECT_THAT(records_of(part_tape(to, 1)), ElementsAre("open 0", "w 1 c", "close 2", "end 2"));
  Bytes bytes = test::read_file(source.write);
  bytes.at(13 + 4) = 0xff;
  test::write_file(source.write, bytes);
  EXPECT_FALSE(split_tape(source, to, options));
  EXPECT_THAT(records_of(part_tape(to, 1)), ElementsAre("open 0", "w 1 c", "close 2", "end 2"));
  for (const char letter : {'r', 'w', 'e'}) std::filesystem::remove(dir / (std::string("u") + letter));
  EXPECT_EQ(files(), before);
}

TEST_F(SplitMergeTest, NoPartAppearsWhereOneCannot) {
  const TapePaths source = tape("t", MemoryTape().open(0).write(1, "a").close(2).open(3).write(4, "b"));
  const TapePaths to = literal_tape(dir / "p.log");
  test::write_file(part_tape(to, 2).write.string(), {});
  SplitOptions options{.at = At::session, .span = {}, .writer = {.sync = false}, .progress = {}};
  const auto taken = split_tape(source, to, options);
  ASSERT_FALSE(taken);
  EXPECT_THAT(taken.error().message, HasSubstr("p.2.log' already; take another name, or --overwrite"));
  EXPECT_FALSE(std::filesystem::exists(part_tape(to, 1).events));
  options.writer.on_existing = OnExisting::overwrite;
  auto live = TapeWriter::create(part_tape(to, 2), TapeHeader{}, options.writer);
  ASSERT_TRUE(live);
  const auto being_written = split_tape(source, to, options);
  ASSERT_FALSE(being_written);
  EXPECT_THAT(being_written.error().message, HasSubstr("is being written"));
  EXPECT_FALSE(std::filesystem::exists(part_tape(to, 1).events));
}

TEST_F(SplitMergeTest, PartsByTimeKeepTheSilenceBeforeTheFirst) {
  const TapePaths source = tape("t", MemoryTape().open(2'500).write(2'600, "a").read(4'100, "b"));
  const auto done = split(source, At::every, 1'000);
  ASSERT_TRUE(done);
  ASSERT_EQ(done->size(), 2U);
  ASSERT_TRUE(merge(part_list(2)));
  EXPECT_THAT(records_of(merged), ElementsAre("open 2500", "w 2600 a", "r 4100 b", "end 4101"));
}

TEST_F(SplitMergeTest, MergedByTheClockTheEarliestGivesTheHeader) {
  const TapePaths late = tape("late", MemoryTape().open(0).write(100, "b").read(100, "B"), zero_at(500));
  const TapePaths early = tape("early", MemoryTape().open(0).read(600, "a").close(700), zero_at(0));
  const auto done = merge({late, early});
  ASSERT_TRUE(done);
  EXPECT_EQ(done->placed, MergedTape::Placed::clock);
  EXPECT_THAT(records_of(merged),
              ElementsAre("open 0", "open 500", "w 600 b", "r 600 B", "r 600 a", "close 700", "end 700"));
  const auto header = header_of(merged);
  ASSERT_TRUE(header);
  EXPECT_EQ(header->device, "early");
  EXPECT_EQ(header->zero, zero_at(0));
  EXPECT_EQ(header->origin->by, "merge");
  ASSERT_EQ(header->origin->tapes.size(), 2U);
  EXPECT_EQ(header->origin->tapes.back(), (PreviousTape{header_of(early)->id, "early"}));
}

TEST_F(SplitMergeTest, OneAfterTheOtherOrAsGiven) {
  const TapePaths one = tape("one", MemoryTape().open(0).read(10, "a"), zero_at(0));
  const TapePaths two = tape("two", MemoryTape().open(0).read(10, "b"), zero_at(0, "another"));
  auto done = merge({one, two});
  ASSERT_TRUE(done);
  EXPECT_EQ(done->placed, MergedTape::Placed::after);
  EXPECT_THAT(records_of(merged), ElementsAre("open 0", "r 10 a", "open 11", "r 21 b", "end 22"));
  done = merge({one, two}, {Micros(-5)});
  ASSERT_TRUE(done);
  EXPECT_THAT(records_of(merged), ElementsAre("open 0", "open 5", "r 10 b", "r 15 a", "end 16"));
  EXPECT_EQ(header_of(merged)->zero, zero_at(0, "another"));
  EXPECT_THAT(merge({one, one}).error().message, HasSubstr("is given twice"));
  const TapePaths copy = literal_tape(dir / "copy");
  for (const auto& [from, to] :
       {std::pair(one.read, copy.read), std::pair(one.write, copy.write), std::pair(one.events, copy.events)})
    std::filesystem::copy_file(from, to);
  EXPECT_THAT(merge({one, copy}).error().message, HasSubstr("has the same id as"));
  EXPECT_THAT(merge({one, two}, {Micros(1), Micros(2)}).error().message, HasSubstr("2 offsets"));
}

TEST_F(SplitMergeTest, AZeroThatCameAsAnEventPlacesATape) {
  const TapePaths one = tape("one", MemoryTape().open(0).read(10, "a"), zero_at(0));
  const TapePaths two = tape("two", MemoryTape().event(0, event::Zero{zero_at(5)}).open(0).read(10, "b"));
  ASSERT_TRUE(merge({one, two}));
  EXPECT_THAT(records_of(merged), ElementsAre("open 0", "open 5", "r 10 a", "r 15 b", "end 16"));
}

TEST_F(SplitMergeTest, ALargeBlockStaysInOnePiece) {
  const std::string large(1'000'000, 'x');
  const TapePaths one = tape("one", MemoryTape().open(0).read(10, large), zero_at(0));
  const TapePaths two = tape("two", MemoryTape().open(0).read(10, "b").read(11, large), zero_at(0));
  ASSERT_TRUE(merge({one, two}));
  const auto blocks = test::decode_independently(test::read_file(merged.read));
  EXPECT_THAT(blocks, ElementsAre(test::Block{10, large}, test::Block{10, "b"}, test::Block{11, large}));
}

TEST_F(SplitMergeTest, TheMergedPartsOfARandomTapeAreThatTape) {
  std::mt19937 random(20260103);
  for (int round = 0; round < 120; ++round) {
    const auto choose = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
    const MemoryTape records = test::random_tape(
        choose, {.sessions = true, .hang_ups = true, .half_closes = true, .gaps = true, .signals = true});
    const auto zero = round % 2 == 0 ? std::optional(zero_at(0)) : std::nullopt;
    const TapePaths source = tape("t" + std::to_string(round), records, zero);
    const std::vector<std::string> all = test::lines_on(source);
    if (all.empty()) continue;
    const At at = std::vector{At::session, At::mark, At::every, At::gap}.at(choose(4));
    const auto done = split(source, at, 1 + choose(60'000));
    ASSERT_TRUE(done) << done.error().message;
    if (done->size() < 2) continue;
    const auto whole = merge(part_list(done->size()));
    ASSERT_TRUE(whole) << whole.error().message;
    EXPECT_EQ(test::lines_on(merged), all) << round;
    EXPECT_EQ(test::carried_on(merged).size(), 0U) << round;
    EXPECT_EQ(test::read_file(merged.read), test::read_file(source.read));
    EXPECT_EQ(header_of(merged)->zero, zero);
  }
}

}  // namespace
}  // namespace porttape
