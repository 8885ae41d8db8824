#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"

namespace porttape {

// How the headers of a tape's blocks are laid out (FORMAT.md).
enum class Layout : std::uint8_t {
  big_endian,  // u32 seconds, microseconds, length: flexiport's format, the only one written
  native64     // i64 seconds, i64 microseconds, u64 length, little-endian: an older recorder's, only read
};
std::string_view to_string(Layout layout);

inline constexpr std::size_t kHeaderSize = 12;
inline constexpr std::size_t kMaxHeaderSize = 24;
constexpr std::size_t header_size(Layout layout) {
  return layout == Layout::big_endian ? kHeaderSize : kMaxHeaderSize;
}

// The latest time a header can hold: 2^32 - 1 seconds and 999 999 µs (136 years).
inline constexpr std::int64_t kMaxBlockTimeUs =
    std::int64_t{std::numeric_limits<std::uint32_t>::max()} * 1'000'000 + 999'999;

// The header of a block as big-endian bytes. `at` is from 0 to kMaxBlockTimeUs.
std::array<Byte, kHeaderSize> encode_header(TapeTime at, std::uint32_t length);

// The fields of a header as they stand in the file, unchecked (negative ones show as huge).
struct BlockHeader {
  std::uint64_t seconds = 0;
  std::uint64_t microseconds = 0;
  std::uint64_t length = 0;

  friend bool operator==(const BlockHeader&, const BlockHeader&) = default;
};

// What a header alone can be guilty of.
enum class HeaderFault : std::uint8_t {
  none,
  microseconds,  // not below 1 000 000
  seconds,       // negative, or beyond 32 bits
  length,        // beyond 32 bits
  time_back      // earlier than the block before
};

namespace detail {
inline std::uint64_t load_be32(const Byte* p) {
  return (std::uint64_t{p[0]} << 24U) | (std::uint64_t{p[1]} << 16U) | (std::uint64_t{p[2]} << 8U) | p[3];
}
inline std::uint64_t load_le64(const Byte* p) {
  std::uint64_t value = 0;
  for (std::size_t i = 8; i-- > 0;) value = (value << 8U) | p[i];
  return value;
}
}  // namespace detail

// `p` points at header_size(layout) bytes.
inline BlockHeader parse_header(Layout layout, const Byte* p) {
  if (layout == Layout::big_endian) {
    return {detail::load_be32(p), detail::load_be32(p + 4), detail::load_be32(p + 8)};
  }
  return {detail::load_le64(p), detail::load_le64(p + 8), detail::load_le64(p + 16)};
}

// The time of a header without a fault.
constexpr std::int64_t header_time_us(const BlockHeader& header) {
  return static_cast<std::int64_t>(header.seconds * 1'000'000 + header.microseconds);
}

// `not_before_us`: the time of the block before.
inline HeaderFault check_header(const BlockHeader& header, std::int64_t not_before_us) {
  constexpr std::uint64_t kMax32 = std::numeric_limits<std::uint32_t>::max();
  if (header.microseconds >= 1'000'000) [[unlikely]]
    return HeaderFault::microseconds;
  if (header.seconds > kMax32) [[unlikely]]
    return HeaderFault::seconds;
  if (header.length > kMax32) [[unlikely]]
    return HeaderFault::length;
  if (header_time_us(header) < not_before_us) [[unlikely]]
    return HeaderFault::time_back;
  return HeaderFault::none;
}

// "microseconds are 5000000, not below 1000000".
std::string describe(HeaderFault fault, const BlockHeader& header, std::int64_t not_before_us);

// A block, or a part of one.
struct BlockPiece {
  TapeTime at{};
  std::uint64_t header_offset = 0;  // of the block's header in its file
  std::uint64_t stream_offset = 0;  // payload bytes of the file before this piece
  std::uint32_t block_length = 0;
  std::uint32_t piece_offset = 0;
  ByteView data;

  [[nodiscard]] bool last() const { return piece_offset + data.size() == block_length; }
};

// Cuts the bytes of an r or w file into blocks. Does no I/O, copies nothing, owns nothing, never allocates.
//
// Drive it by next() with the unread bytes of the file: on `piece`, drop consumed() bytes from the front and
// go on with the rest; on `need_bytes`, call again with the same bytes and more, at least needed() in all.
// `past_end` and `damage` consume nothing and come again until reset (past_end: or until set_end() tells that
// the file has grown). Offsets are in bytes.
class BlockDecoder {
 public:
  enum class Step : std::uint8_t { piece, need_bytes, past_end, damage };

  explicit BlockDecoder(Layout layout) : layout_(layout) {}
  // From a block on whose header is at `offset` of its file, with so many payload bytes before it.
  BlockDecoder(Layout layout, std::uint64_t offset, std::uint64_t stream_offset)
      : layout_(layout), offset_(offset) {
    piece_.stream_offset = stream_offset;
  }

  // Where the file ends. A block that reaches further gives `past_end` and no piece of it is given.
  void set_end(std::uint64_t file_size) { end_ = file_size; }

  // `whole`: wait until the whole block is there; else give what is there of it.
  Step next(ByteView input, bool whole);

  [[nodiscard]] const BlockPiece& piece() const { return piece_; }
  [[nodiscard]] std::size_t consumed() const { return consumed_; }
  [[nodiscard]] std::uint64_t needed() const { return needed_; }

  [[nodiscard]] Layout layout() const { return layout_; }
  [[nodiscard]] std::uint64_t offset() const { return offset_; }  // of the front of the input in the file
  [[nodiscard]] bool inside_block() const { return left_ > 0; }
  [[nodiscard]] const BlockHeader& header() const {
    return header_;
  }  // after past_end and damage: the one meant
  [[nodiscard]] std::int64_t last_time_us() const { return last_us_; }
  [[nodiscard]] std::string damage() const { return describe(fault_, header_, last_us_); }

 private:
  Step start_block(ByteView input, bool whole);
  Step need(std::uint64_t bytes) {
    needed_ = bytes;
    return Step::need_bytes;
  }

  Layout layout_;
  HeaderFault fault_ = HeaderFault::none;
  std::uint32_t left_ = 0;  // payload of the current block not given yet
  std::int64_t last_us_ = 0;
  std::uint64_t offset_ = 0;
  std::uint64_t end_ = std::numeric_limits<std::uint64_t>::max();
  std::uint64_t needed_ = 0;
  std::size_t consumed_ = 0;
  BlockHeader header_;
  BlockPiece piece_;
};

inline BlockDecoder::Step BlockDecoder::start_block(ByteView input, bool whole) {
  const std::size_t head = header_size(layout_);
  if (input.size() < head) return need(head);
  header_ = parse_header(layout_, input.data());
  fault_ = check_header(header_, last_us_);
  if (fault_ != HeaderFault::none) [[unlikely]]
    return Step::damage;
  if (header_.length > end_ || offset_ + head > end_ - header_.length) [[unlikely]]
    return Step::past_end;
  const std::size_t there = input.size() - head;
  if (there < header_.length && (whole || there == 0)) return need(head + (whole ? header_.length : 1));

  const std::size_t take = there < header_.length ? there : static_cast<std::size_t>(header_.length);
  piece_.stream_offset += piece_.data.size();
  piece_.at = tape_time_us(last_us_ = header_time_us(header_));
  piece_.header_offset = offset_;
  piece_.block_length = static_cast<std::uint32_t>(header_.length);
  piece_.piece_offset = 0;
  piece_.data = input.subspan(head, take);
  left_ = piece_.block_length - static_cast<std::uint32_t>(take);
  consumed_ = head + take;
  offset_ += consumed_;
  return Step::piece;
}

inline BlockDecoder::Step BlockDecoder::next(ByteView input, bool whole) {
  if (left_ == 0) [[likely]]
    return start_block(input, whole);
  if (input.empty()) return need(1);
  const std::size_t take = input.size() < left_ ? input.size() : left_;
  piece_.stream_offset += piece_.data.size();
  piece_.piece_offset = piece_.block_length - left_;
  piece_.data = input.first(take);
  left_ -= static_cast<std::uint32_t>(take);
  consumed_ = take;
  offset_ += take;
  return Step::piece;
}

}  // namespace porttape
