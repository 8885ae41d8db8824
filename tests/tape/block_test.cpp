#include "libport/tape/block.hpp"

#include <gtest/gtest.h>

#include "tests/support/tape_bytes.hpp"

namespace porttape {
namespace {

using test::Block;

TEST(BlockHeader, IsThreeBigEndianWords) {
  const auto header = encode_header(tape_time_us(10'964), 2);
  EXPECT_EQ(to_hex(header), "0000000000002ad400000002");
  EXPECT_EQ(parse_header(Layout::big_endian, header.data()), (BlockHeader{0, 10'964, 2}));
}

TEST(BlockHeader, HoldsTheWholeRange) {
  const auto header = encode_header(tape_time_us(kMaxBlockTimeUs), 0xFFFFFFFF);
  EXPECT_EQ(to_hex(header), "ffffffff000f423fffffffff");
  EXPECT_EQ(header_time_us(parse_header(Layout::big_endian, header.data())), kMaxBlockTimeUs);
}

TEST(BlockHeader, NativeLayoutIsThreeLittleEndianWordsOf64Bits) {
  const Bytes header = test::header_bytes(1, 93, 10, true);
  EXPECT_EQ(to_hex(header), "01000000000000005d000000000000000a00000000000000");
  EXPECT_EQ(parse_header(Layout::native64, header.data()), (BlockHeader{1, 93, 10}));
}

TEST(BlockHeader, EveryFaultIsNamed) {
  EXPECT_EQ(check_header({0, 999'999, 0}, 0), HeaderFault::none);
  EXPECT_EQ(check_header({0, 1'000'000, 0}, 0), HeaderFault::microseconds);
  EXPECT_EQ(check_header({0, static_cast<std::uint64_t>(-1), 0}, 0), HeaderFault::microseconds);
  EXPECT_EQ(check_header({0x1'0000'0000, 0, 0}, 0), HeaderFault::seconds);
  EXPECT_EQ(check_header({static_cast<std::uint64_t>(-1), 0, 0}, 0), HeaderFault::seconds);
  EXPECT_EQ(check_header({0, 0, 0x1'0000'0000}, 0), HeaderFault::length);
  EXPECT_EQ(check_header({1, 5, 0}, 1'000'006), HeaderFault::time_back);
  EXPECT_EQ(check_header({1, 5, 0}, 1'000'005), HeaderFault::none);
}

// Gives the decoder `bytes` in chunks that end at `cuts` and puts the pieces together again.
std::vector<Block> decode(const Bytes& bytes, Layout layout, const std::vector<std::size_t>& cuts,
                          bool whole) {
  BlockDecoder decoder(layout);
  std::vector<Block> blocks;
  std::size_t begin = 0;
  for (const std::size_t end : cuts) {
    for (;;) {
      const BlockDecoder::Step step = decoder.next(ByteView(bytes).subspan(begin, end - begin), whole);
      if (step != BlockDecoder::Step::piece) {
        EXPECT_EQ(step, BlockDecoder::Step::need_bytes);
        EXPECT_GT(decoder.needed(), end - begin);
        break;
      }
      EXPECT_EQ(decoder.offset(), begin + decoder.consumed());
      begin += decoder.consumed();
      const BlockPiece& piece = decoder.piece();
      EXPECT_TRUE(!whole || (piece.piece_offset == 0 && piece.last()));
      if (piece.piece_offset == 0) blocks.push_back({to_us(piece.at), ""});
      blocks.back().data += as_text(piece.data);
      EXPECT_EQ(blocks.back().data.size(), piece.piece_offset + piece.data.size());
    }
  }
  EXPECT_EQ(begin, bytes.size());
  return blocks;
}

TEST(BlockDecoder, GivesTheSameHoweverTheBytesAreCut) {
  const std::vector<Block> blocks{
      {0, "a"}, {26, ""}, {26, "VV\n"}, {1'000'000, "0123456789"}, {5'000'001, "z"}};
  for (const bool native64 : {false, true}) {
    const Layout layout = native64 ? Layout::native64 : Layout::big_endian;
    const Bytes bytes = test::block_bytes(blocks, native64);
    for (std::size_t first = 0; first <= bytes.size(); ++first) {
      for (std::size_t second = first; second <= bytes.size(); ++second) {
        for (const bool whole : {false, true}) {
          ASSERT_EQ(decode(bytes, layout, {first, second, bytes.size()}, whole), blocks)
              << first << ' ' << second;
        }
      }
    }
  }
}

TEST(BlockDecoder, TellsWhereEachBlockStands) {
  const Bytes bytes = test::block_bytes({{1, "abc"}, {2, "de"}});
  BlockDecoder decoder(Layout::big_endian);
  ASSERT_EQ(decoder.next(bytes, true), BlockDecoder::Step::piece);
  ASSERT_EQ(decoder.next(ByteView(bytes).subspan(15), true), BlockDecoder::Step::piece);
  EXPECT_EQ(decoder.piece().header_offset, 15U);
  EXPECT_EQ(decoder.piece().stream_offset, 3U);
}

TEST(BlockDecoder, ABlockBeyondTheEndGivesNoPiece) {
  const Bytes bytes = test::block_bytes({{1, "abc"}});
  BlockDecoder decoder(Layout::big_endian);
  decoder.set_end(bytes.size() - 1);
  EXPECT_EQ(decoder.next(ByteView(bytes).first(bytes.size() - 1), false), BlockDecoder::Step::past_end);
  decoder.set_end(bytes.size());
  EXPECT_EQ(decoder.next(bytes, false), BlockDecoder::Step::piece);
}

TEST(BlockDecoder, DamageStays) {
  Bytes bytes = test::block_bytes({{1'000'000, "abc"}});
  const Bytes earlier = test::header_bytes(0, 999'999, 0);
  bytes.insert(bytes.end(), earlier.begin(), earlier.end());
  BlockDecoder decoder(Layout::big_endian);
  ASSERT_EQ(decoder.next(bytes, true), BlockDecoder::Step::piece);
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(decoder.next(ByteView(bytes).subspan(15), true), BlockDecoder::Step::damage);
    EXPECT_EQ(decoder.offset(), 15U);
    EXPECT_EQ(decoder.damage(), "time goes back from 1.000000 s to 0.999999 s");
  }
}

}  // namespace
}  // namespace porttape
