#include "tools/view_packer.hpp"

#include <zlib.h>

#include "libport/formats/base64.hpp"

namespace porttape {
namespace {

void put_varint(Bytes& out, std::uint64_t value) {
  for (; value >= 0x80; value >>= 7U) out.push_back(static_cast<Byte>(value | 0x80U));
  out.push_back(static_cast<Byte>(value));
}

void put_u32(Bytes& out, std::uint64_t value) {
  for (unsigned shift = 0; shift < 32; shift += 8) out.push_back(static_cast<Byte>(value >> shift));
}

std::uint64_t zigzag(std::int64_t value) {
  const auto bits = static_cast<std::uint64_t>(value) << 1U;
  return value < 0 ? ~bits : bits;
}

}  // namespace

Result<std::string> pack_for_page(ByteView bytes) {
  constexpr int kLevel = 5;  // the next ones take twice the time for a few percent
  uLongf size = compressBound(static_cast<uLong>(bytes.size()));
  Bytes packed(size);
  if (compress2(packed.data(), &size, bytes.data(), static_cast<uLong>(bytes.size()), kLevel) != Z_OK)
    return make_error(Errc::io, "the tape cannot be compressed: zlib has no memory");
  return to_base64(ByteView(packed).first(size));
}

Result<void> ViewPacker::add(const Record& record) {
  const bool reads = record.kind == RecordKind::read;
  if (!reads && record.kind != RecordKind::write) {
    put_varint(columns_.lines, zigzag(to_us(record.at)));
    put_varint(columns_.lines, blocks_);
    put_varint(columns_.lines, record.event_line.size());
    append(columns_.lines, as_bytes(record.event_line));
    ++columns_.events;
    ++events_;
  } else {
    const std::size_t side = reads ? 0 : 1;
    if (record.piece_offset == 0) {
      put_varint(columns_.times, static_cast<std::uint64_t>(to_us(record.at) - last_us_));
      put_varint(columns_.lengths, std::uint64_t{record.block_length} * 2 + side);
      last_us_ = to_us(record.at);
      ++columns_.blocks;
      ++blocks_;
    }
    append(columns_.data.at(side), record.data);
    bytes_.at(side) += record.data.size();
  }
  return columns_.size() < kChunk ? Result<void>() : flush();
}

Result<void> ViewPacker::finish() { return columns_.size() == 0 ? Result<void>() : flush(); }

Result<void> ViewPacker::flush() {
  Bytes chunk;
  chunk.reserve(columns_.size() + 24);
  put_u32(chunk, columns_.blocks);
  put_u32(chunk, columns_.events);
  put_u32(chunk, columns_.times.size());
  put_u32(chunk, columns_.lengths.size());
  put_u32(chunk, columns_.lines.size());
  put_u32(chunk, columns_.data[0].size());
  for (const Bytes* column :
       {&columns_.times, &columns_.lengths, &columns_.lines, &columns_.data[0], &columns_.data[1]})
    append(chunk, *column);
  columns_ = {};
  const Result<std::string> packed = pack_for_page(chunk);
  if (!packed) return packed.error();
  return sink_(*packed);
}

}  // namespace porttape
