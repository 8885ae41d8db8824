#include "libport/tape/end_check.hpp"

#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "libport/tape/disks.hpp"
#include "tests/support/tape_bytes.hpp"
#include "tests/support/temp_dir.hpp"

namespace porttape {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

HeldFile holds(const std::string& path, const PayloadTotals& totals) {
  return {.path = path, .exists = true, .totals = totals};
}
HeldFile is_missing(const std::string& path) { return {.path = path, .exists = false}; }

// What the end tells of: r 2 blocks and 9 bytes, w 3 blocks and 5 bytes.
const PayloadTotals kToldRead{2, 9, 0x11};
const PayloadTotals kToldWrite{3, 5, 0x22};

EndFindings findings(const HeldFile& read, const HeldFile& write, const PayloadTotals& told_read = kToldRead,
                     const PayloadTotals& told_write = kToldWrite) {
  return compare_with_end(read, write, {told_read, told_write}, "e");
}
std::vector<std::string> damages_of_read(const PayloadTotals& totals) {
  return findings(holds("r", totals), holds("w", kToldWrite)).damages;
}

TEST(EndFindings, AreNoneWhereBothAreAsTold) {
  const EndFindings none = findings(holds("r", kToldRead), holds("w", kToldWrite));
  EXPECT_THAT(none.damages, IsEmpty());
  EXPECT_THAT(none.notes, IsEmpty());
}

TEST(EndFindings, ADigestThatIsNotToldFitsAny) {
  EXPECT_THAT(damages_of_read({2, 9, std::nullopt}), IsEmpty());
  EXPECT_THAT(findings(holds("r", {2, 9, 0x33}), holds("w", kToldWrite), {2, 9, std::nullopt}).damages,
              IsEmpty());
  EXPECT_THAT(
      damages_of_read({2, 9, 0x33}),
      ElementsAre("r is another tape's, or changed: it holds 2 blocks, 9 bytes, xxh3 0000000000000033; "
                  "e tells of 2 blocks, 9 bytes, xxh3 0000000000000011"));
}

TEST(EndFindings, LessOfOneAndMoreOfNeitherIsShortened) {
  const auto shortened = [](const PayloadTotals& totals) {
    return damages_of_read(totals).at(0).starts_with("r is shortened, or another tape's: it holds ");
  };
  EXPECT_TRUE(shortened({1, 9, 0x33}));
  EXPECT_TRUE(shortened({2, 8, 0x33}));
  EXPECT_TRUE(shortened({0, 0, 0x33}));
  EXPECT_FALSE(shortened({3, 8, 0x33}));
  EXPECT_FALSE(shortened({1, 10, 0x33}));
  EXPECT_FALSE(shortened({2, 10, 0x33}));
  EXPECT_FALSE(shortened({3, 9, 0x33}));
  EXPECT_THAT(damages_of_read({1, 1, 0x33}),
              ElementsAre("r is shortened, or another tape's: it holds 1 block, 1 byte; e tells of 2 blocks, "
                          "9 bytes"));
}

TEST(EndFindings, WhatBelongsInTheOtherFileIsNamedAndASwapOnlyWhereBothDo) {
  EXPECT_THAT(findings(holds("r", kToldWrite), holds("w", kToldRead)).damages,
              ElementsAre("r and w are swapped: each holds what e tells of the other"));
  EXPECT_THAT(
      damages_of_read(kToldWrite),
      ElementsAre("r is what belongs in w: it holds 3 blocks, 5 bytes; e tells of 2 blocks, 9 bytes"));
  EXPECT_THAT(findings(holds("r", kToldRead), holds("w", kToldRead)).damages,
              ElementsAre(HasSubstr("w is what belongs in r")));
  EXPECT_THAT(findings(holds("r", kToldWrite), holds("w", {1, 1, 0x33})).damages,
              ElementsAre(HasSubstr("r is what belongs in w"), HasSubstr("w is shortened"),
                          HasSubstr("e may be another tape's itself")));
  EXPECT_THAT(findings(holds("r", {1, 1, 0x33}), holds("w", kToldRead)).damages,
              ElementsAre(HasSubstr("r is shortened"), HasSubstr("w is what belongs in r"),
                          HasSubstr("e may be another tape's itself")));
}

TEST(EndFindings, ADamagedFileIsNotCompared) {
  HeldFile damaged = holds("r", {1, 1, 0x33});
  damaged.damaged = true;
  EXPECT_THAT(findings(damaged, holds("w", kToldWrite)).damages, IsEmpty());
  EXPECT_THAT(findings(damaged, holds("w", {1, 1, 0x33})).damages,
              ElementsAre(HasSubstr("w is shortened"), HasSubstr("e may be another tape's itself")));
}

TEST(EndFindings, AFileWithDataThatIsAsToldVouchesForTheEvents) {
  const std::string foreign = "e may be another tape's itself: nothing beside it is what it tells of";
  const PayloadTotals nothing{0, 0, 0x44};
  const HeldFile changed = holds("r", {2, 9, 0x33});
  const auto damages = [&](const HeldFile& read, const HeldFile& write, const PayloadTotals& told_write) {
    return findings(read, write, kToldRead, told_write).damages;
  };
  EXPECT_THAT(damages(changed, holds("w", {1, 1, 0x55}), {1, 1, 0x55}), ElementsAre(HasSubstr("r is")));
  EXPECT_THAT(damages(changed, holds("w", nothing), nothing), ElementsAre(HasSubstr("r is"), foreign));
  EXPECT_THAT(damages(changed, is_missing("w"), {0, 0, 0}), ElementsAre(HasSubstr("r is"), foreign));
  EXPECT_THAT(damages(is_missing("r"), holds("w", nothing), nothing), ElementsAre(HasSubstr("r is missing")));
  EXPECT_THAT(damages(is_missing("r"), is_missing("w"), kToldWrite),
              ElementsAre("r is missing: e tells of 2 blocks, 9 bytes", HasSubstr("w is missing")));
  EXPECT_THAT(damages(is_missing("r"), holds("w", {3, 5, 0x33}), kToldWrite),
              ElementsAre(HasSubstr("r is missing"), HasSubstr("w is another"), foreign));
}

TEST(EndFindings, AFileThatIsMissingAndHeldNothingIsANote) {
  const EndFindings both = findings(is_missing("r"), is_missing("w"), {0, 0, 0}, {0, 0, 0});
  EXPECT_THAT(both.damages, IsEmpty());
  EXPECT_THAT(both.notes, ElementsAre("r is missing; it held nothing", "w is missing; it held nothing"));
  EXPECT_THAT(findings(is_missing("r"), holds("w", kToldWrite)).notes, IsEmpty());
}

Record block_of(RecordKind kind, ByteView data, std::uint32_t piece_offset = 0) {
  Record record;
  record.kind = kind;
  record.data = data;
  record.block_length = static_cast<std::uint32_t>(data.size());
  record.piece_offset = piece_offset;
  return record;
}
Record event_of(const Event& event) {
  Record record;
  record.event = &event;
  return record;
}

PayloadTotals totals_of(std::initializer_list<std::string_view> blocks) {
  PayloadCounter counter;
  for (const std::string_view block : blocks) {
    counter.begin_block(TapeTime{}, static_cast<std::uint32_t>(block.size()));
    counter.add(as_bytes(block));
  }
  return counter.totals();
}

class EndCheckTest : public testing::Test {
 protected:
  const EndCheck::Names names{"r", "w", "e", true, true};
  const Event told = event::End{totals_of({"abcd"}), totals_of({"x", "y"}), {}};
  const Event closed = event::Close{};
  TapeTime read_at{};
  EndCheck check{names, TapeHeader{.device = "d", .driver = "p", .id = "i"}};

  void pass_blocks(std::string_view read = "abcd") {
    check.pass(block_of(RecordKind::write, as_bytes("x")));
    Record first = block_of(RecordKind::read, as_bytes(read.substr(0, 2)));
    first.at = read_at;
    first.block_length = 4;
    check.pass(first);
    check.pass(block_of(RecordKind::read, as_bytes(read.substr(2)), 2));
    check.pass(block_of(RecordKind::write, as_bytes("y")));
  }
};

TEST_F(EndCheckTest, FindsNoFlawWhereWhatPassedIsWhatTheEndTells) {
  pass_blocks();
  EXPECT_EQ(check.flaw(), std::nullopt);
  check.pass(event_of(told));
  EXPECT_EQ(check.flaw(), std::nullopt);
}

TEST_F(EndCheckTest, OtherBytesAreAFlawUnlessTheHeaderHasNoId) {
  pass_blocks("abcD");
  check.pass(event_of(told));
  ASSERT_TRUE(check.flaw());
  EXPECT_EQ(check.flaw()->code, Errc::damaged_tape);
  EXPECT_THAT(check.flaw()->message, HasSubstr("r is another tape's, or changed"));
  check.pass(event_of(closed));
  EXPECT_EQ(check.flaw(), std::nullopt) << "the last event is no end";
  for (const auto& header :
       {std::optional<TapeHeader>(), std::optional(TapeHeader{.device = "d", .driver = "p"})}) {
    EXPECT_FALSE(has_digests(header));
    check = EndCheck(names, header);
    pass_blocks("abcD");
    check.pass(event_of(told));
    EXPECT_EQ(check.flaw(), std::nullopt);
  }
}

TEST_F(EndCheckTest, AnotherTimeOfABlockIsAFlaw) {
  read_at = tape_time_us(1);
  pass_blocks();
  check.pass(event_of(told));
  ASSERT_TRUE(check.flaw());
  EXPECT_THAT(
      check.flaw()->message,
      testing::MatchesRegex("r has other times or lengths of blocks: their xxh3_all is [0-9a-f]{16}, and e "
                            "tells of [0-9a-f]{16}"));
  event::End older = std::get<event::End>(told);
  older.read->xxh3_all.reset();
  check.pass(event_of(older));
  EXPECT_EQ(check.flaw(), std::nullopt) << "an older recorder told the data alone";
}

TEST_F(EndCheckTest, AllThatIsWrongIsInOneMessage) {
  check.pass(event_of(told));
  EXPECT_EQ(check.flaw()->message,
            "r is shortened, or another tape's: it holds 0 blocks, 0 bytes; e tells of 1 block, 4 bytes; "
            "w is shortened, or another tape's: it holds 0 blocks, 0 bytes; e tells of 2 blocks, 2 bytes; "
            "e may be another tape's itself: nothing beside it is what it tells of");
}

TEST_F(EndCheckTest, BeginsAgain) {
  pass_blocks();
  check.pass(event_of(told));
  check.rewind();
  EXPECT_EQ(check.flaw(), std::nullopt);
  pass_blocks();
  check.pass(event_of(told));
  EXPECT_EQ(check.flaw(), std::nullopt);
}

TEST_F(EndCheckTest, AnEndThatTellsOfOneFileIsNotCompared) {
  const Event of_read = event::End{totals_of({"zz"}), std::nullopt, {}};
  const Event of_write = event::End{std::nullopt, totals_of({"zz"}), {}};
  for (const Event* const end : {&of_read, &of_write}) {
    check.pass(event_of(*end));
    EXPECT_EQ(check.flaw(), std::nullopt);
  }
}

TEST_F(EndCheckTest, KnowsOfATapeOnTheDiskWhichFilesAreThere) {
  const test::TempDir dir;
  const TapePaths tape = literal_tape(dir / "t");
  EXPECT_FALSE(EndCheck::Names::of(tape).has_read);
  test::write_file(tape.read, {});
  const EndCheck::Names with_read = EndCheck::Names::of(tape);
  EXPECT_TRUE(with_read.has_read && !with_read.has_write);
  EXPECT_EQ(with_read.read, tape.read.string());
  EXPECT_EQ(with_read.write, tape.write.string());
  EXPECT_EQ(with_read.events, tape.events.string());
  std::filesystem::rename(tape.read, tape.write);
  const EndCheck::Names with_write = EndCheck::Names::of(tape);
  EXPECT_TRUE(!with_write.has_read && with_write.has_write);
}

TEST(PayloadCounter, CountsAndDigestsInAnyPieces) {
  PayloadCounter counter;
  counter.begin_block(tape_time_us(1'000'002), 2);
  counter.add(as_bytes("V"));
  counter.add(as_bytes("V"));
  counter.begin_block(tape_time_us(3'000'004), 1);
  counter.add(as_bytes("\n"));
  const Bytes file = test::block_bytes({{1'000'002, "VV"}, {3'000'004, "\n"}});
  EXPECT_EQ(counter.totals(), (PayloadTotals{2, 3, 0xdffe3986f0f2f0a6, digest_of(file)}));  // `xxhsum -H3`
  EXPECT_EQ(counter.bytes(), 3U);
  EXPECT_EQ(digest_of(as_bytes("VV\n")), 0xdffe3986f0f2f0a6);
  EXPECT_NE(digest_of(as_bytes("VV\n"), 1), 0xdffe3986f0f2f0a6);
  EXPECT_EQ(digest_text(0xabc), "0000000000000abc");
  PayloadCounter bare(false);
  bare.begin_block(TapeTime{}, 2);
  bare.add(as_bytes("VV"));
  EXPECT_EQ(bare.totals(), (PayloadTotals{1, 2, std::nullopt}));
}

TEST(StreamDigest, ACopyGoesOnByItself) {
  StreamDigest digest;
  digest.add(as_bytes("V"));
  StreamDigest copy = digest;
  copy.add(as_bytes("V\n"));
  EXPECT_EQ(copy.value(), digest_of(as_bytes("VV\n")));
  EXPECT_EQ(digest.value(), digest_of(as_bytes("V")));
  digest = copy;
  EXPECT_EQ(digest.value(), copy.value());
}

TEST(Disks, HaveRoomForWhatWaitsUpToTheirLimit) {
  Disks disks;
  EXPECT_TRUE(disks.reserve(Disks::kMostWaiting - 1));
  EXPECT_FALSE(disks.reserve(2));
  EXPECT_TRUE(disks.reserve(1));
  EXPECT_FALSE(disks.reserve(1));
  disks.release(1);
  EXPECT_TRUE(disks.reserve(1));
}

TEST(Disks, WhatWasOnceSlowIsKnownToWhoAsksLater) {
  Disks disks;
  disks.note_slow(7);
  EXPECT_TRUE(*disks.slow(7));
  EXPECT_FALSE(*disks.slow(8));
  const auto asked = disks.slow(9);
  EXPECT_FALSE(*asked);
  disks.note_slow(9);
  EXPECT_TRUE(*asked);
}

}  // namespace
}  // namespace porttape
