#include "libport/tape/block_salvage.hpp"

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/failing_source.hpp"
#include "tests/support/holed_source.hpp"
#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using test::Block;
using testing::ElementsAre;
using testing::ElementsAreArray;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr std::string_view kGarbage =
    "\xff\xfe\xfd\xfc\xfb\xfa\xf9\xf8\xf7\xf6\xf5\xf4\xf3\xf2\xf1\xf0\xef\xee\xed\xec\xeb\xea\xe9\xe8\xe7";

// "5 3@15" for a block of 3 bytes at 5 us whose data is at 15; "lost 5 at 10 from 3: why".
std::vector<std::string> salvaged(std::unique_ptr<ByteSource> source, Layout layout, std::uint64_t size) {
  BlockSalvage salvage(std::move(source), layout, size);
  std::vector<std::string> all;
  for (;;) {
    const auto step = salvage.next();
    if (!step) return {"error: " + step.error().message};
    if (step->lost)
      all.push_back("lost " + std::to_string(step->lost->bytes) + " at " +
                    std::to_string(step->lost->offset) + " from " + std::to_string(to_us(step->lost->from)) +
                    ": " + step->lost->why);
    if (!step->lost && !step->block) return all;
    if (!step->block) continue;
    all.push_back(std::to_string(to_us(step->block->at)) + " " + std::to_string(step->block->length) + "@" +
                  std::to_string(step->block->data_offset));
  }
}

std::vector<std::string> salvaged(const Bytes& bytes, Layout layout = Layout::big_endian) {
  return salvaged(test::memory("b", bytes), layout, bytes.size());
}

// Blocks of 4 bytes each, which take 16 in the file: number n, from 0 on, at (n + 1) ms.
std::vector<Block> numbered(std::size_t count) {
  std::vector<Block> blocks;
  for (std::size_t n = 0; n < count; ++n) blocks.push_back({static_cast<std::int64_t>(n + 1) * 1000, "data"});
  return blocks;
}

std::vector<std::string> told(std::size_t from, std::size_t to, std::size_t shift = 0,
                              std::size_t head = 12) {
  std::vector<std::string> all;
  for (std::size_t n = from; n < to; ++n)
    all.push_back(std::to_string((n + 1) * 1000) + " 4@" + std::to_string(n * (head + 4) + head + shift));
  return all;
}

std::vector<std::string> joined(std::initializer_list<std::vector<std::string>> lists) {
  std::vector<std::string> all;
  for (const auto& list : lists) all.insert(all.end(), list.begin(), list.end());
  return all;
}

void overwrite(Bytes& bytes, std::size_t at, std::string_view with) {
  std::copy(with.begin(), with.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at));
}

TEST(BlockSalvage, GivesTheBlocksOfASoundFile) {
  EXPECT_THAT(salvaged({}), IsEmpty());
  EXPECT_EQ(salvaged(test::block_bytes(numbered(3))), told(0, 3));
  EXPECT_EQ(salvaged(test::block_bytes(numbered(20))), told(0, 20));
  EXPECT_EQ(salvaged(test::block_bytes(numbered(20), true), Layout::native64), told(0, 20, 0, 24));
  EXPECT_THAT(salvaged(test::block_bytes({{5, ""}, {5, ""}, {5, "a"}})),
              ElementsAre("5 0@12", "5 0@24", "5 1@36"));
}

TEST(BlockSalvage, GivesTheDataOfABlock) {
  const Bytes bytes = test::block_bytes(numbered(2));
  BlockSalvage salvage(test::memory("b", bytes), Layout::big_endian, bytes.size());
  EXPECT_EQ(as_text(*salvage.data(12, 4)), "data");
  EXPECT_EQ(as_text(*salvage.data(14, 1)), "t");
  EXPECT_EQ(as_text(*salvage.data(30, 10)), "ta");
  EXPECT_EQ(salvage.name(), "b");
}

TEST(BlockSalvage, AnUnfinishedBlockAtTheEndIsLost) {
  const Bytes whole = test::block_bytes(numbered(3));
  for (const std::size_t size : {33U, 43U, 44U, 47U}) {
    const Bytes torn(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_EQ(
        salvaged(torn),
        joined({told(0, 2), {"lost " + std::to_string(size - 32) + " at 32 from 2000: an unfinished block"}}))
        << size;
  }
}

TEST(BlockSalvage, AHeaderThatIsDestroyedCostsItsBlockInEitherLayout) {
  for (const bool native64 : {false, true}) {
    const std::size_t head = native64 ? 24 : 12;
    const Layout layout = native64 ? Layout::native64 : Layout::big_endian;
    for (const std::size_t at : {0U, 1U, 5U, 10U, 19U}) {
      Bytes bytes = test::block_bytes(numbered(20), native64);
      overwrite(bytes, at * (head + 4), kGarbage.substr(0, head));
      const std::vector<std::string> all = salvaged(bytes, layout);
      ASSERT_EQ(all.size(), 20U);
      EXPECT_THAT(all[at],
                  HasSubstr("lost " + std::to_string(head + 4) + " at " + std::to_string(at * (head + 4)) +
                            " from " + std::to_string(at * 1000) + ": microseconds are "));
      EXPECT_EQ(joined({{all.begin(), all.begin() + static_cast<std::ptrdiff_t>(at)},
                        {all.begin() + static_cast<std::ptrdiff_t>(at) + 1, all.end()}}),
                joined({told(0, at, 0, head), told(at + 1, 20, 0, head)}));
    }
  }
}

TEST(BlockSalvage, ABlockAtTheEndOfASecondIsFoundBehindGarbageToo) {
  std::vector<Block> blocks;
  for (std::int64_t n = 0; n < 20; ++n) blocks.push_back({990'000 + n * 500, "data"});
  for (const bool native64 : {false, true}) {
    const std::size_t head = native64 ? 24 : 12;
    Bytes bytes = test::block_bytes(blocks, native64);
    overwrite(bytes, head + 4, kGarbage.substr(0, head));
    const std::vector<std::string> all = salvaged(bytes, native64 ? Layout::native64 : Layout::big_endian);
    ASSERT_EQ(all.size(), 20U) << native64;
    EXPECT_THAT(all[1], HasSubstr("lost " + std::to_string(head + 4)));
    EXPECT_EQ(all[2], "991000 4@" + std::to_string(2 * (head + 4) + head));
  }
}

// `count` blocks behind garbage, and whether they were found.
bool finds(std::size_t count, std::string_view behind, std::size_t before = 10) {
  const Bytes lead = test::block_bytes(numbered(before));
  Bytes bytes = lead;
  test::append(bytes, kGarbage);
  std::vector<Block> blocks = numbered(before + count);
  blocks.erase(blocks.begin(), blocks.begin() + static_cast<std::ptrdiff_t>(before));
  const Bytes rest = test::block_bytes(blocks);
  bytes.insert(bytes.end(), rest.begin(), rest.end());
  test::append(bytes, behind);
  const std::vector<std::string> all = salvaged(bytes);
  const std::string lost = "lost 25 at " + std::to_string(16 * before);
  for (const std::string& each : all) {
    if (each.starts_with(lost)) return true;
  }
  return false;
}

TEST(BlockSalvage, BlocksBehindDamageCountOnceTheyAreSure) {
  EXPECT_TRUE(finds(1, "")) << "to the exact end";
  EXPECT_FALSE(finds(1, "\x01")) << "an unfinished header";
  EXPECT_TRUE(finds(2, "\x01"));
  EXPECT_FALSE(finds(2, kGarbage)) << "damage again";
  EXPECT_TRUE(finds(3, kGarbage));
  EXPECT_TRUE(finds(8, kGarbage));
}

TEST(BlockSalvage, EmptyBlocksAreNoEvidence) {
  Bytes bytes = test::block_bytes(numbered(10));
  test::append(bytes, kGarbage);
  for (int i = 0; i < 5; ++i) {
    const Bytes header = test::header_bytes(0, 50'000, 0);
    bytes.insert(bytes.end(), header.begin(), header.end());
  }
  test::append(bytes, kGarbage);
  EXPECT_EQ(salvaged(bytes).size(), 11U);
}

TEST(BlockSalvage, ASilenceOfMoreThanTenDaysBehindDamageIsNone) {
  constexpr std::int64_t kTenDays = 864'000'000'000;
  for (const std::int64_t more : {0, 1}) {
    Bytes bytes = test::block_bytes(numbered(10));
    test::append(bytes, kGarbage);
    const Bytes rest = test::block_bytes({{10'000 + kTenDays + more, "data"}});
    bytes.insert(bytes.end(), rest.begin(), rest.end());
    EXPECT_EQ(salvaged(bytes).back().starts_with("lost"), more == 1);
  }
}

TEST(BlockSalvage, ATimeThatIsTooEarlyBecomesThatOfTheBlockBefore) {
  std::vector<Block> blocks = numbered(20);
  blocks[10].us = 5;
  const std::vector<std::string> all = salvaged(test::block_bytes(blocks));
  EXPECT_EQ(all, joined({told(0, 10),
                         {"lost 0 at 160 from 10000: time goes back from 0.010000 s to 0.000005 s; the block "
                          "stays, at the time of the one beside it",
                          "10000 4@172"},
                         told(11, 20)}));
}

TEST(BlockSalvage, ATimeThatIsTooLateBecomesThatOfTheBlockBehind) {
  std::vector<Block> blocks = numbered(20);
  blocks[10].us = 3'000'000'000;
  const std::vector<std::string> all = salvaged(test::block_bytes(blocks));
  EXPECT_EQ(all,
            joined({told(0, 10),
                    {"lost 0 at 160 from 10000: time goes back from 3000.000000 s to 0.012000 s; the block "
                     "stays, at the time of the one beside it",
                     "12000 4@172"},
                    told(11, 20)}));
}

TEST(BlockSalvage, TheFirstAndTheLastTimeAreMendedToo) {
  std::vector<Block> blocks = numbered(20);
  blocks[0].us = 3'000'000'000;
  std::vector<std::string> all = salvaged(test::block_bytes(blocks));
  ASSERT_EQ(all.size(), 21U);
  EXPECT_THAT(all[0], HasSubstr("lost 0 at 0 from 0: time goes back"));
  EXPECT_EQ(all[1], "2000 4@12");
  blocks = numbered(20);
  blocks[19].us = 5;
  all = salvaged(test::block_bytes(blocks));
  ASSERT_EQ(all.size(), 21U);
  EXPECT_THAT(all[19], HasSubstr("lost 0 at 304 from 19000: time goes back"));
  EXPECT_EQ(all[20], "19000 4@316");
}

TEST(BlockSalvage, TimesThatStayEarlierAreToldOnce) {
  std::vector<Block> blocks = numbered(10);
  for (const Block& again : numbered(10)) blocks.push_back(again);
  const std::vector<std::string> all = salvaged(test::block_bytes(blocks));
  ASSERT_EQ(all.size(), 21U);
  EXPECT_THAT(all[10], HasSubstr("lost 0 at 160 from 10000"));
  for (std::size_t n = 10; n < 20; ++n) EXPECT_EQ(all[n + 1], "10000 4@" + std::to_string(n * 16 + 12));
  blocks.push_back({11'000, "data"});
  blocks.push_back({12'000, "data"});
  blocks.push_back({5, "data"});
  blocks.push_back({13'000, "data"});
  const std::vector<std::string> more = salvaged(test::block_bytes(blocks));
  ASSERT_EQ(more.size(), 26U);
  EXPECT_EQ(more[22], "12000 4@348");
  EXPECT_THAT(more[23], HasSubstr("lost 0 at 352 from 12000")) << "a new fault is told again";
}

TEST(BlockSalvage, ALengthThatSwallowsBlocksGivesThemBack) {
  for (const std::size_t at : {0U, 3U, 12U}) {
    Bytes bytes = test::block_bytes(numbered(20));
    bytes[at * 16 + 11] = 0x38;  // up to somewhere in a later one
    const std::vector<std::string> all = salvaged(bytes);
    const std::vector<std::string> before = told(0, at);
    const std::vector<std::string> behind = told(at + 1, 20);
    ASSERT_EQ(all.size(), 20U);
    EXPECT_EQ(std::vector(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(at)), before);
    EXPECT_THAT(all[at],
                HasSubstr("lost 16 at " + std::to_string(at * 16) + " from " + std::to_string(at * 1000)));
    EXPECT_EQ(std::vector(all.begin() + static_cast<std::ptrdiff_t>(at) + 1, all.end()), behind);
  }
}

// Blocks that were swallowed up to exactly where the next one begins go on with that one.
TEST(BlockSalvage, ALengthThatSwallowsWholeBlocksGivesAllOfThemBack) {
  for (const std::size_t swallowed : {2U, 8U, 9U, 20U}) {
    const Bytes inside = test::block_bytes(numbered(swallowed));
    Bytes bytes = test::block_bytes({{90'000'000, std::string(as_text(inside))}});
    const Bytes behind = test::block_bytes({{static_cast<std::int64_t>(swallowed + 1) * 1000, "data"}});
    bytes.insert(bytes.end(), behind.begin(), behind.end());
    test::append(bytes, kGarbage);
    const std::vector<std::string> all = salvaged(bytes);
    ASSERT_EQ(all.size(), swallowed + 3) << swallowed;
    EXPECT_THAT(all.front(), HasSubstr("lost 12 at 0 from 0: "));
    EXPECT_EQ(std::vector(all.begin() + 1, all.end() - 1), told(0, swallowed + 1, 12));
    EXPECT_THAT(all.back(), HasSubstr("lost 25 at " + std::to_string(12 + 16 * (swallowed + 1))));
  }
}

// As that of a tape which a tape of its transfer holds.
TEST(BlockSalvage, ABlockWhoseDataIsBlocksStaysWhereTheyEndWithIt) {
  const Bytes inside = test::block_bytes(numbered(9));
  Bytes bytes = test::block_bytes({{500, std::string(as_text(inside))}});
  test::append(bytes, kGarbage);
  EXPECT_THAT(salvaged(bytes), ElementsAre("500 144@12", HasSubstr("lost 25 at 156 from 500: ")));
  const Bytes behind = test::block_bytes(numbered(9));
  bytes.insert(bytes.end(), behind.begin(), behind.end());
  EXPECT_EQ(salvaged(bytes).size(), 11U);
  EXPECT_EQ(salvaged(bytes).front(), "500 144@12");
}

TEST(BlockSalvage, ALengthThatIsTooSmallByLessThanAHeaderIsMended) {
  Bytes bytes = test::block_bytes(numbered(20));
  bytes[10 * 16 + 11] = 1;
  const std::vector<std::string> all = salvaged(bytes);
  EXPECT_EQ(all,
            joined({told(0, 10),
                    {"lost 0 at 160 from 10000: a length of 1 is too small by 3; the block stays, with them",
                     "11000 4@172"},
                    told(11, 20)}));
}

TEST(BlockSalvage, HoldsBlocksWhereTheyFollowOneAnother) {
  const auto holds = [](const Bytes& bytes, Layout layout = Layout::big_endian) {
    MemorySource source("s", bytes);
    return *BlockSalvage::holds_blocks(source, layout, bytes.size());
  };
  EXPECT_FALSE(holds({}));
  EXPECT_FALSE(holds(test::bytes_of(std::string(kGarbage) + std::string(kGarbage))));
  Bytes bytes = test::bytes_of(kGarbage);
  const Bytes blocks = test::block_bytes(numbered(3));
  bytes.insert(bytes.end(), blocks.begin(), blocks.end());
  EXPECT_TRUE(holds(bytes));
  EXPECT_FALSE(holds(bytes, Layout::native64));
  EXPECT_TRUE(holds(test::block_bytes(numbered(3), true), Layout::native64));
  EXPECT_FALSE(holds(test::block_bytes(numbered(3), true)));
}

TEST(BlockSalvage, OneBlockFromTheFirstByteToTheLastIsEnough) {
  for (const bool native64 : {false, true}) {
    const Bytes bytes = test::block_bytes(numbered(1), native64);
    MemorySource source("s", bytes);
    const Layout layout = native64 ? Layout::native64 : Layout::big_endian;
    EXPECT_TRUE(*BlockSalvage::holds_blocks(source, layout, bytes.size()));
    EXPECT_FALSE(*BlockSalvage::holds_blocks(source, layout, bytes.size() - 1)) << "a torn one is none";
  }
}

TEST(BlockSalvage, AFailedReadIsItsErrorWhereverItComes) {
  std::vector<Block> blocks = numbered(20);
  blocks[5].us = 5;
  Bytes bytes = test::block_bytes(blocks);
  overwrite(bytes, 12 * 16, kGarbage.substr(0, 12));
  int failed = 0;
  for (int reads = 0; reads < 10; ++reads) {
    BlockSalvage salvage(std::make_unique<test::FailingSource>(bytes, reads), Layout::big_endian,
                         bytes.size());
    for (;;) {
      const auto step = salvage.next();
      if (!step) {
        EXPECT_EQ(step.error().message, "out of order");
        ++failed;
        break;
      }
      if (!step->lost && !step->block) break;
    }
  }
  EXPECT_EQ(failed, 3) << "each time that it reads the file anew";
  test::FailingSource source(bytes, 0);
  EXPECT_EQ(BlockSalvage::holds_blocks(source, Layout::big_endian, bytes.size()).error().message,
            "out of order");
}

TEST(BlockSalvage, AFileThatHasBecomeShorterIsToldSo) {
  const Bytes bytes = test::block_bytes(numbered(3));
  BlockSalvage salvage(test::memory("b", Bytes(bytes.begin(), bytes.begin() + 20)), Layout::big_endian,
                       bytes.size());
  EXPECT_EQ(salvage.next().error(), make_error(Errc::io, "b became shorter while it was read"));
}

TEST(BlockSalvage, BlocksBehindDamageDoNotGoBackInTime) {
  Bytes bytes = test::block_bytes(numbered(10));
  test::append(bytes, kGarbage);
  const Bytes back =
      test::block_bytes({{50'000, "data"}, {40'000, "data"}, {30'000, "data"}, {20'000, "data"}});
  bytes.insert(bytes.end(), back.begin(), back.end());
  test::append(bytes, kGarbage);
  EXPECT_EQ(salvaged(bytes).size(), 11U);
}

TEST(BlockSalvage, ATimeIsMendedToThatOfTheBlockBehindAlsoWhereThatIsAsTheOneBefore) {
  std::vector<Block> blocks = numbered(20);
  blocks[10].us = 3'000'000'000;
  blocks[11].us = blocks[9].us;
  const std::vector<std::string> all = salvaged(test::block_bytes(blocks));
  ASSERT_EQ(all.size(), 21U);
  EXPECT_EQ(all[11], "10000 4@172");
  EXPECT_EQ(all[12], "10000 4@188");
}

TEST(BlockSalvage, ABlockThatProvesToBeNoneIsLostWithWhatIsAroundIt) {
  Bytes bytes = test::block_bytes(numbered(10));
  test::append(bytes, kGarbage);
  const Bytes late =
      test::block_bytes({{3'600'000'000, "data"}, {3'600'000'001, "data"}, {3'600'000'002, "data"}});
  bytes.insert(bytes.end(), late.begin(), late.end());
  test::append(bytes, kGarbage);
  std::vector<Block> rest = numbered(30);
  rest.erase(rest.begin(), rest.begin() + 15);
  const Bytes behind = test::block_bytes(rest);
  bytes.insert(bytes.end(), behind.begin(), behind.end());
  const std::vector<std::string> all = salvaged(bytes);
  ASSERT_EQ(all.size(), 26U);
  EXPECT_THAT(all[10], testing::StartsWith("lost 98 at 160 from 10000: "));
  EXPECT_THAT(all[11], testing::StartsWith("16000 4@"));
}

constexpr std::uint64_t kTerabyte = std::uint64_t{1} << 40U;
constexpr std::uint64_t kPlentyForAHole = std::uint64_t{4} << 20U;  // of reading

TEST(BlockSalvage, AHoleIsLostAndNotRead) {
  const Bytes blocks = test::block_bytes(numbered(20));
  Bytes behind;
  for (std::size_t n = 0; n < 20; ++n) {
    const Bytes one = test::block_bytes({{static_cast<std::int64_t>(n + 21) * 1000, "data"}});
    behind.insert(behind.end(), one.begin(), one.end());
  }
  test::HoledSource::Read read;
  auto source = std::make_unique<test::HoledSource>(
      read, kTerabyte, std::map<std::uint64_t, Bytes>{{0, blocks}, {kTerabyte - behind.size(), behind}});
  const auto all = salvaged(std::move(source), Layout::big_endian, kTerabyte);
  ASSERT_EQ(all.size(), 41U);
  EXPECT_EQ(std::vector(all.begin(), all.begin() + 20), told(0, 20));
  EXPECT_EQ(all[20], "lost " + std::to_string(kTerabyte - behind.size() - blocks.size()) +
                         " at 320 from 20000: a hole in the file");
  EXPECT_EQ(all[40], "40000 4@" + std::to_string(kTerabyte - 4));
  EXPECT_LT(read.bytes, kPlentyForAHole);
}

TEST(BlockSalvage, AFileThatBeginsWithAHoleIsNoRowOfEmptyBlocks) {
  const Bytes blocks = test::block_bytes(numbered(20));
  test::HoledSource::Read read;
  auto source = std::make_unique<test::HoledSource>(read, kTerabyte,
                                                    std::map<std::uint64_t, Bytes>{{kTerabyte / 2, blocks}});
  const auto all = salvaged(std::move(source), Layout::big_endian, kTerabyte);
  ASSERT_EQ(all.size(), 22U);
  EXPECT_EQ(all[0], "lost " + std::to_string(kTerabyte / 2) + " at 0 from 0: a hole in the file");
  EXPECT_THAT(all[21], HasSubstr("a hole in the file"));
}

TEST(BlockSalvage, ABlockWithAHoleInItsDataIsNone) {
  Bytes blocks = test::block_bytes(numbered(20));
  const Bytes header = test::header_bytes(0, 21'000, 3'000'000'000);
  blocks.insert(blocks.end(), header.begin(), header.end());
  test::HoledSource::Read read;
  auto source =
      std::make_unique<test::HoledSource>(read, kTerabyte, std::map<std::uint64_t, Bytes>{{0, blocks}});
  const auto all = salvaged(std::move(source), Layout::big_endian, kTerabyte);
  ASSERT_EQ(all.size(), 21U);
  EXPECT_THAT(all[20], HasSubstr("at 320 from 20000: a block with a hole in its data"));
  EXPECT_LT(read.bytes, kPlentyForAHole);
}

// A copy leaves out zeros that a device has sent.
TEST(BlockSalvage, AShortHoleIsZeros) {
  constexpr std::size_t kZeros = 300'000;
  const Bytes blocks = test::block_bytes(numbered(20));
  Bytes header = test::header_bytes(0, 21'000, kZeros);
  const std::uint64_t end = blocks.size() + header.size() + kZeros;
  const Bytes behind = test::block_bytes({{22'000, "data"}, {23'000, "data"}});
  test::HoledSource::Read read;
  auto source = std::make_unique<test::HoledSource>(
      read, end + behind.size(),
      std::map<std::uint64_t, Bytes>{{0, blocks}, {blocks.size(), std::move(header)}, {end, behind}});
  const auto all = salvaged(std::move(source), Layout::big_endian, end + behind.size());
  ASSERT_EQ(all.size(), 23U);
  EXPECT_EQ(all[20], "21000 300000@332");
  EXPECT_EQ(all[22], "23000 4@" + std::to_string(end + 28));
}

// Headers that each lead to one far away which cannot follow: times go down with the place.
TEST(BlockSalvage, WhatOnlyLooksLikeBlocksIsGivenUpByWhatItCosts) {
  constexpr std::size_t kHeaders = 1 << 15U;
  Bytes bytes = test::block_bytes(numbered(20));
  std::uint64_t random = 1;
  for (std::size_t n = 0; n < kHeaders; ++n) {
    random = random * 6364136223846793005U + 1442695040888963407U;
    const std::uint64_t left = kHeaders - n;
    const Bytes header = test::header_bytes(10 + left / 1'000'000, left % 1'000'000,
                                            12 * (left / 2 + (random >> 33U) % (left / 2 + 1)));
    bytes.insert(bytes.end(), header.begin(), header.end());
  }
  test::append(bytes, kGarbage.substr(0, 5));
  test::HoledSource::Read read;
  auto source =
      std::make_unique<test::HoledSource>(read, bytes.size(), std::map<std::uint64_t, Bytes>{{0, bytes}});
  const auto all = salvaged(std::move(source), Layout::big_endian, bytes.size());
  EXPECT_GT(all.size(), 20U);
  EXPECT_THAT(all, testing::Contains(HasSubstr("was given up")));
  EXPECT_LT(read.calls, bytes.size() / 2) << "of at most a microsecond each";
}

}  // namespace
}  // namespace porttape
