#include "libport/tape/block_file.hpp"

#include <algorithm>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using test::Block;
using testing::HasSubstr;
using Step = BlockFile::Step;
using Blocks = BlockFile::Blocks;

struct Outcome {
  std::vector<Block> blocks;
  std::string damage;
  std::uint64_t damage_offset = 0;
  std::uint64_t torn_bytes = 0;
};

Outcome read_through(BlockFile& file) {
  Outcome outcome;
  for (;;) {
    const Step step = file.next();
    if (step == Step::piece) {
      if (file.piece().piece_offset == 0) outcome.blocks.push_back({to_us(file.piece().at), ""});
      outcome.blocks.back().data += as_text(file.piece().data);
      continue;
    }
    EXPECT_EQ(file.next(), step);  // it stays so
    if (step == Step::failed) {
      outcome.damage = file.error().message;
      outcome.damage_offset = file.error_offset();
      EXPECT_EQ(file.error().code, Errc::damaged_tape);
    }
    outcome.torn_bytes = file.torn_bytes();
    return outcome;
  }
}

Outcome read_through(Bytes bytes, Layout layout = Layout::big_endian) {
  BlockFile file(test::memory("t.logr", std::move(bytes)), layout, Blocks::whole);
  return read_through(file);
}

std::vector<Block> many_blocks(int count) {
  std::vector<Block> blocks;
  for (int i = 0; i < count; ++i) {
    blocks.push_back({1'000'000 + i * 1000, "block number " + std::to_string(i) + std::string(50, '.')});
  }
  return blocks;
}

TEST(BlockFile, EveryTruncationIsATornTailAndLosesOnlyTheTornBlock) {
  const std::vector<Block> blocks{{5, "first"}, {6, ""}, {7, "second block"}, {2'000'000, "third"}};
  for (const bool native64 : {false, true}) {
    const Bytes whole = test::block_bytes(blocks, native64);
    for (std::size_t size = 0; size <= whole.size(); ++size) {
      const Outcome outcome =
          read_through(Bytes(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size)),
                       native64 ? Layout::native64 : Layout::big_endian);
      std::vector<Block> expected;
      std::size_t counted = 0;
      for (const Block& block : blocks) {
        const std::size_t length = test::block_bytes({block}, native64).size();
        if (counted + length > size) break;
        counted += length;
        expected.push_back(block);
      }
      EXPECT_EQ(outcome.damage, "") << size;
      EXPECT_EQ(outcome.blocks, expected) << size;
      EXPECT_EQ(outcome.torn_bytes, size - counted) << size;
    }
  }
}

TEST(BlockFile, IsReadFromAnyBlockOnAgainAndAgain) {
  const std::vector<Block> blocks = many_blocks(10'000);
  BlockFile file(test::memory("t.logr", test::block_bytes(blocks)), Layout::big_endian, Blocks::whole);
  struct Place {
    std::uint64_t offset, stream_offset;
  };
  std::vector<Place> places;
  while (file.next() == Step::piece)
    places.push_back({file.piece().header_offset, file.piece().stream_offset});
  for (const std::size_t at : {std::size_t{9'999}, std::size_t{0}, std::size_t{5'000}}) {
    file.seek(places[at].offset, places[at].stream_offset);
    for (std::size_t i = at; i < std::min(at + 3, blocks.size()); ++i) {
      ASSERT_EQ(file.next(), Step::piece);
      EXPECT_EQ(as_text(file.piece().data), blocks[i].data);
      EXPECT_EQ(to_us(file.piece().at), blocks[i].us);
      EXPECT_EQ(file.piece().stream_offset, places[i].stream_offset);
      EXPECT_EQ(file.piece().header_offset, places[i].offset);
    }
  }
}

TEST(BlockFile, DamageIsToldWithOffsetAndReason) {
  const std::vector<Block> blocks = many_blocks(3);
  const std::size_t second = test::block_bytes({blocks[0]}).size();
  Bytes bad = test::block_bytes(blocks);
  bad[second + 5] = 0xFF;
  Outcome outcome = read_through(bad);
  EXPECT_EQ(outcome.damage_offset, second);
  EXPECT_EQ(outcome.damage, "t.logr is damaged at offset 76: microseconds are 16712680, not below 1000000");
  EXPECT_EQ(outcome.blocks.size(), 1U);

  bad = test::block_bytes(blocks);
  bad[second + 3] = 0;
  outcome = read_through(bad);
  EXPECT_EQ(outcome.damage_offset, second);
  EXPECT_THAT(outcome.damage, HasSubstr("time goes back from 1.000000 s to 0.001000 s"));
}

TEST(BlockFile, FaultsThatOnlyTheNativeLayoutCanHave) {
  const auto read = [](std::uint64_t seconds, std::uint64_t microseconds, std::uint64_t length) {
    Bytes bytes = test::block_bytes({{1, "a"}}, true);
    const Bytes header = test::header_bytes(seconds, microseconds, length, true);
    bytes.insert(bytes.end(), header.begin(), header.end());
    return read_through(bytes, Layout::native64).damage;
  };
  EXPECT_THAT(read(1ULL << 32U, 0, 0), HasSubstr("offset 25: seconds are 4294967296, not from 0"));
  EXPECT_THAT(read(static_cast<std::uint64_t>(-3), 0, 0), HasSubstr("seconds are -3"));
  EXPECT_THAT(read(1, 0, 1ULL << 32U), HasSubstr("a block of 4294967296 bytes"));
  EXPECT_THAT(read(1, 1'000'000, 0), HasSubstr("microseconds"));
}

TEST(BlockFile, AWrongLengthInMidFileIsDamage) {
  for (const bool native64 : {false, true}) {
    const Layout layout = native64 ? Layout::native64 : Layout::big_endian;
    const std::vector<Block> blocks = many_blocks(20);
    const std::size_t stride = test::block_bytes(blocks, native64).size();
    // The length's most significant byte that makes it larger than the file but no fault by itself.
    const std::size_t at = native64 ? 16 + 3 : 8;
    for (const std::size_t which : {0U, 5U, 18U}) {
      Bytes bytes = test::block_bytes(blocks, native64);
      std::size_t offset = 0;
      for (std::size_t i = 0; i < which; ++i) offset += test::block_bytes({blocks[i]}, native64).size();
      bytes[offset + at] = 0x7F;
      const Outcome outcome = read_through(bytes, layout);
      EXPECT_EQ(outcome.damage_offset, offset) << which << " of " << stride;
      EXPECT_THAT(outcome.damage, HasSubstr("runs past the end of the file, but blocks follow from offset"));
      EXPECT_EQ(outcome.blocks.size(), which);
    }
  }
}

TEST(BlockFile, AWrongLengthInMidFileIsDamageEvenWhereTheTailIsTornToo) {
  Bytes bytes = test::block_bytes(many_blocks(20));
  bytes[8] = 0x10;
  bytes.erase(bytes.end() - 7, bytes.end());
  EXPECT_THAT(read_through(bytes).damage, HasSubstr("damaged at offset 0: a length of"));
}

TEST(BlockFile, AWrongLengthInTheLastBlockCannotBeToldFromATornTail) {
  Bytes bytes = test::block_bytes({{1, "abc"}, {2, "def"}});
  bytes[15 + 8] = 0x10;
  const Outcome outcome = read_through(bytes);
  EXPECT_EQ(outcome.damage, "");
  EXPECT_EQ(outcome.torn_bytes, 15U);
}

TEST(BlockFile, ATornBlockFullOfPatternsIsStillATornTail) {
  const std::vector<std::string> patterns{std::string(1, '\0'),
                                          std::string("\0\x01", 2),
                                          std::string("\0\0\0\x05", 4),
                                          std::string("\0\0\0\x01\0\0\0\0", 8),
                                          "text\n",
                                          std::string(1, '\xff')};
  for (const std::string& pattern : patterns) {
    std::string payload;
    while (payload.size() < 60'000) payload += pattern;
    Bytes bytes = test::block_bytes({{1'500'000'000, "whole"}, {1'500'000'100, payload}});
    bytes.erase(bytes.end() - 100, bytes.end());
    const Outcome outcome = read_through(bytes);
    EXPECT_EQ(outcome.damage, "") << to_hex(as_bytes(pattern));
    EXPECT_EQ(outcome.blocks.size(), 1U);
  }
}

TEST(BlockFile, ABlockLargerThanTheBufferComesInPieces) {
  std::string big(BlockFile::kBufferSize * 3 + 17, '\0');
  for (std::size_t i = 0; i < big.size(); ++i) big[i] = static_cast<char>(i * 7 + i / 251);
  const std::vector<Block> blocks{{1, "small"}, {2, big}, {3, "after"}};
  BlockFile file(test::memory("t", test::block_bytes(blocks)), Layout::big_endian, Blocks::whole);
  EXPECT_EQ(read_through(file).blocks, blocks);
}

TEST(BlockFile, ABlockThatFitsIsOnePieceWhereverItStands) {
  const std::size_t sizes[] = {1, 4096, 65'536, 200'000, BlockFile::kBufferSize - kHeaderSize};
  for (const std::size_t size : sizes) {
    std::vector<Block> blocks;
    for (std::size_t i = 0; i < 9; ++i) {
      blocks.push_back({static_cast<std::int64_t>(i), std::string(size - i % 2, static_cast<char>('a' + i))});
    }
    BlockFile file(test::memory("t", test::block_bytes(blocks)), Layout::big_endian, Blocks::whole);
    for (const Block& block : blocks) {
      ASSERT_EQ(file.next(), Step::piece);
      EXPECT_EQ(file.piece().piece_offset, 0U);
      EXPECT_TRUE(file.piece().last());
      EXPECT_EQ(as_text(file.piece().data), block.data);
    }
    EXPECT_EQ(file.next(), Step::end);
  }
}

TEST(BlockFile, RewindStartsAgainAlsoAfterDamage) {
  Bytes bytes = test::block_bytes({{5, "a"}, {4, "b"}});
  BlockFile file(test::memory("t", bytes), Layout::big_endian, Blocks::whole);
  const Outcome first = read_through(file);
  file.rewind();
  const Outcome second = read_through(file);
  EXPECT_EQ(first.damage, second.damage);
  EXPECT_EQ(second.blocks, (std::vector<Block>{{5, "a"}}));
}

// Bytes that grow and can fail.
class AppendedSource final : public ByteSource {
 public:
  explicit AppendedSource(Bytes& bytes, const int& reads_left) : bytes_(bytes), reads_left_(reads_left) {}
  Result<std::size_t> read_at(std::uint64_t offset, std::span<Byte> into) override {
    if (reads_left_ == 0) return make_error(Errc::io, "out of order");
    return MemorySource("g", bytes_).read_at(offset, into);
  }
  Result<std::uint64_t> size() override { return bytes_.size(); }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  Bytes& bytes_;
  const int& reads_left_;
  std::string name_ = "g";
};

TEST(BlockFile, SeesWhatWasAppendedMeanwhile) {
  Bytes bytes = test::block_bytes({{1, "a"}});
  const int always = -1;
  BlockFile file(std::make_unique<AppendedSource>(bytes, always), Layout::big_endian, Blocks::whole);
  ASSERT_EQ(file.next(), Step::piece);
  const Bytes more = test::block_bytes({{2, "bcd"}});
  bytes.insert(bytes.end(), more.begin(), more.end());
  ASSERT_EQ(file.next(), Step::piece);
  EXPECT_EQ(as_text(file.piece().data), "bcd");
  EXPECT_EQ(file.next(), Step::end);
}

TEST(BlockFile, AFailedReadIsAnErrorThatStays) {
  Bytes bytes = test::block_bytes({{1, "a"}});
  int reads_left = 0;
  BlockFile file(std::make_unique<AppendedSource>(bytes, reads_left), Layout::big_endian, Blocks::whole);
  EXPECT_EQ(file.next(), Step::failed);
  EXPECT_EQ(file.error().code, Errc::io);
  reads_left = -1;
  EXPECT_EQ(file.next(), Step::failed);
  file.rewind();
  EXPECT_EQ(file.next(), Step::piece);
}

// 6 GiB in blocks of 512 MiB that are never stored; counts what is read at once.
class HugeSource final : public ByteSource {
 public:
  static constexpr std::uint64_t kBlock = (512U << 20U) + kHeaderSize;
  static constexpr std::uint64_t kBlocks = 12;

  explicit HugeSource(std::size_t& largest_read) : largest_read_(largest_read) {}
  Result<std::size_t> read_at(std::uint64_t offset, std::span<Byte> into) override {
    largest_read_ = std::max(largest_read_, into.size());
    const std::uint64_t end = kBlock * kBlocks;
    const auto count =
        static_cast<std::size_t>(std::min<std::uint64_t>(into.size(), offset < end ? end - offset : 0));
    for (std::uint64_t block = offset / kBlock; block < kBlocks && block * kBlock < offset + count; ++block) {
      const auto header = encode_header(tape_time_us(static_cast<std::int64_t>(block)), kBlock - kHeaderSize);
      for (std::size_t i = 0; i < header.size(); ++i) {
        const std::uint64_t at = block * kBlock + i;
        if (at >= offset && at < offset + count) into[static_cast<std::size_t>(at - offset)] = header[i];
      }
    }
    return count;
  }
  Result<std::uint64_t> size() override { return kBlock * kBlocks; }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  std::size_t& largest_read_;
  std::string name_ = "huge";
};

TEST(BlockFile, ATapeOver4GiBIsReadThroughOneBuffer) {
  std::size_t largest_read = 0;
  BlockFile file(std::make_unique<HugeSource>(largest_read), Layout::big_endian, Blocks::whole);
  std::uint64_t blocks = 0;
  std::uint64_t bytes = 0;
  Step step = file.next();
  for (; step == Step::piece; step = file.next()) {
    EXPECT_EQ(file.piece().stream_offset, bytes);
    if (file.piece().piece_offset == 0) {
      EXPECT_EQ(file.piece().header_offset, blocks++ * HugeSource::kBlock);
    }
    bytes += file.piece().data.size();
  }
  EXPECT_EQ(step, Step::end);
  EXPECT_EQ(blocks, HugeSource::kBlocks);
  EXPECT_EQ(bytes, HugeSource::kBlocks * (512ULL << 20U));
  EXPECT_EQ(file.torn_bytes(), 0U);
  EXPECT_LE(largest_read, BlockFile::kBufferSize);
}

}  // namespace
}  // namespace porttape
