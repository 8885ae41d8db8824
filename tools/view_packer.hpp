#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// The bytes as zlib packs them (RFC 1950), in base64: nothing in it is ever markup. Errc::io: no memory.
Result<std::string> pack_for_page(ByteView bytes);

// Packs a tape for the page of `porttape view`: give it the records in order. What comes out are chunks, each
// pack_for_page() of
//   6 u32, little-endian: blocks, events, and the sizes of all but the last of these columns:
//   a varint a block: microseconds since the block before, which may be in another chunk (the first: since
//   0); a varint a block: 2 * length, + 1 where the driver writes; of each event varints of its time
//   (zigzag), how many blocks of the tape are before it, the size of its line, and that line; the bytes of
//   reads; the bytes of writes.
// A block's bytes may go on in the next chunks. Varints are LEB128. Memory: a chunk.
class ViewPacker {
 public:
  using Sink = std::function<Result<void>(std::string_view chunk)>;
  explicit ViewPacker(Sink sink) : sink_(std::move(sink)) {}

  Result<void> add(const Record& record);
  Result<void> finish();

  [[nodiscard]] std::uint64_t blocks() const { return blocks_; }
  [[nodiscard]] std::uint64_t events() const { return events_; }
  // Of reads, of writes.
  [[nodiscard]] std::array<std::uint64_t, 2> bytes() const { return bytes_; }

 private:
  static constexpr std::size_t kChunk = std::size_t{4} << 20U;

  struct Columns {
    std::uint32_t blocks = 0;
    std::uint32_t events = 0;
    Bytes times;
    Bytes lengths;
    Bytes lines;
    std::array<Bytes, 2> data;  // reads, writes

    [[nodiscard]] std::size_t size() const {
      return times.size() + lengths.size() + lines.size() + data[0].size() + data[1].size();
    }
  };

  Result<void> flush();

  Sink sink_;
  Columns columns_;
  std::int64_t last_us_ = 0;
  std::uint64_t blocks_ = 0;
  std::uint64_t events_ = 0;
  std::array<std::uint64_t, 2> bytes_{};
};

}  // namespace porttape
