#include "libport/tape/resync.hpp"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/failing_source.hpp"
#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using test::Block;

constexpr std::int64_t kDayUs = 86'400'000'000;
constexpr std::string_view kNoise =
    "\xff\xfe\xfd\xfc\xfb\xfa\xf9\xf8\xf7\xf6\xf5\xf4\xf3\xf2\xf1\xf0\xff\xfe\xfd\xfc\xfb\xfa\xf9\xf8\xf7";

Bytes after_noise(std::size_t noise, const Bytes& rest, std::string_view behind = {}) {
  Bytes bytes(noise, Byte{0xff});
  bytes.insert(bytes.end(), rest.begin(), rest.end());
  test::append(bytes, behind);
  return bytes;
}

std::optional<std::uint64_t> chain_in(const Bytes& bytes, std::int64_t not_before_us = 0,
                                      Layout layout = Layout::big_endian, std::uint64_t from = 0) {
  MemorySource source("s", bytes);
  const auto found = find_block_chain(source, layout, from, bytes.size(), not_before_us);
  if (!found) throw std::runtime_error(found.error().message);
  return *found;
}

std::vector<Block> blocks_of(std::size_t count, std::int64_t first_us = 1, std::int64_t step_us = 1) {
  std::vector<Block> blocks;
  for (std::size_t i = 0; i < count; ++i)
    blocks.push_back({first_us + static_cast<std::int64_t>(i) * step_us, "data"});
  return blocks;
}

TEST(BlockChain, IsLongEnoughWithEightBlocksOrToTheEnd) {
  for (const bool native64 : {false, true}) {
    const Layout layout = native64 ? Layout::native64 : Layout::big_endian;
    for (const std::size_t count : {1U, 2U, 7U, 8U, 9U}) {
      const Bytes blocks = test::block_bytes(blocks_of(count), native64);
      EXPECT_EQ(chain_in(after_noise(5, blocks), 0, layout), 5U) << count;
      const auto found = chain_in(after_noise(5, blocks, kNoise), 0, layout);
      EXPECT_EQ(found, count >= 8 ? std::optional(std::uint64_t{5}) : std::nullopt) << count;
      EXPECT_EQ(chain_in(after_noise(5, blocks, "\xff"), 0, layout).has_value(), count >= 8) << count;
    }
  }
}

TEST(BlockChain, BeginsWhereTheSearchDoesOrBehind) {
  const Bytes bytes = test::block_bytes(blocks_of(3));
  EXPECT_EQ(chain_in(bytes), 0U);
  EXPECT_EQ(chain_in(bytes, 0, Layout::big_endian, 1), 16U);
  EXPECT_EQ(chain_in(bytes, 0, Layout::big_endian, 32), 32U);
  EXPECT_EQ(chain_in(bytes, 0, Layout::big_endian, 33), std::nullopt);
  EXPECT_EQ(chain_in(bytes, 0, Layout::big_endian, 48), std::nullopt);
  EXPECT_EQ(chain_in(bytes, 0, Layout::big_endian, 60), std::nullopt);
}

TEST(BlockChain, IsFoundAtAnyOffsetOfTheWindowThatIsSearched) {
  const Bytes blocks = test::block_bytes(blocks_of(2));
  for (std::size_t noise = 4070; noise < 4110; ++noise)
    EXPECT_EQ(chain_in(after_noise(noise, blocks)), noise);
}

TEST(BlockChain, BeginsAtMostAMebibyteFurther) {
  constexpr std::size_t kFarthest = std::size_t{1} << 20;
  const Bytes blocks = test::block_bytes(blocks_of(1));
  EXPECT_EQ(chain_in(after_noise(kFarthest, blocks)), kFarthest);
  EXPECT_EQ(chain_in(after_noise(kFarthest + 1, blocks)), std::nullopt);
}

TEST(BlockChain, BeginsNoEarlierThanTheBlockBeforeAndAtMostADayLater) {
  const Bytes bytes = test::block_bytes({{5'000'000, "data"}});
  EXPECT_EQ(chain_in(bytes, 5'000'000), 0U);
  EXPECT_EQ(chain_in(bytes, 5'000'001), std::nullopt);
  EXPECT_EQ(chain_in(test::block_bytes({{7 + kDayUs, "data"}}), 7), 0U);
  EXPECT_EQ(chain_in(test::block_bytes({{8 + kDayUs, "data"}}), 7), std::nullopt);
}

TEST(BlockChain, EachBlockIsLaterThanTheOneBeforeByADayAtMost) {
  EXPECT_EQ(chain_in(test::block_bytes(blocks_of(2, 0, 1))), 0U);
  EXPECT_EQ(chain_in(test::block_bytes(blocks_of(2, 0, 0))), 16U) << "only the last reaches the end";
  EXPECT_EQ(chain_in(test::block_bytes(blocks_of(2, 5, -1))), 16U);
  EXPECT_EQ(chain_in(test::block_bytes(blocks_of(2, 0, kDayUs + 1))), 0U);
  EXPECT_EQ(chain_in(test::block_bytes(blocks_of(2, 0, kDayUs + 2))), std::nullopt);
}

TEST(BlockChain, HasDataInEachBlock) {
  EXPECT_EQ(chain_in(test::block_bytes({{1, ""}})), std::nullopt);
  EXPECT_EQ(chain_in(test::block_bytes({{1, "a"}, {2, ""}})), std::nullopt);
}

TEST(BlockChain, EndsWithinTheFile) {
  Bytes bytes = test::block_bytes({{1, "a"}, {2, "bc"}});
  bytes.pop_back();
  EXPECT_EQ(chain_in(bytes), std::nullopt);
  for (std::size_t size = 0; size <= kHeaderSize; ++size) {
    const Bytes header = test::header_bytes(0, 1, 5);
    EXPECT_EQ(chain_in(Bytes(header.begin(), header.begin() + static_cast<std::ptrdiff_t>(size))),
              std::nullopt);
  }
}

TEST(BlockChain, AFailedReadIsItsError) {
  const Bytes bytes = test::block_bytes(blocks_of(3));
  for (const int reads : {0, 1, 2}) {
    test::FailingSource source(bytes, reads);
    EXPECT_EQ(find_block_chain(source, Layout::big_endian, 0, bytes.size(), 0).error().message,
              "out of order");
  }
}

TEST(BlockChain, WhereTheFileHasBecomeShorterThereIsNone) {
  const Bytes bytes = test::block_bytes(blocks_of(3));
  for (const std::ptrdiff_t size : {0, 11, 16, 27}) {
    test::FailingSource source(Bytes(bytes.begin(), bytes.begin() + size), -1);
    EXPECT_EQ(find_block_chain(source, Layout::big_endian, 0, bytes.size(), 0).value(), std::nullopt) << size;
  }
}

}  // namespace
}  // namespace porttape
