#pragma once

#include <cstdint>
#include <memory>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/tape/byte_source.hpp"
#include "libport/tape/record.hpp"
#include "libport/tape/tape_reader.hpp"

// The bytes of tapes, put together and taken apart without the code under test.
namespace porttape::test {

struct Block {
  std::int64_t us = 0;
  std::string data;

  friend bool operator==(const Block&, const Block&) = default;
  friend std::ostream& operator<<(std::ostream& out, const Block& block) {
    return out << block.us << " us \"" << to_printable(as_bytes(block.data)) << '"';
  }
};

inline void append(Bytes& out, std::string_view text) { out.insert(out.end(), text.begin(), text.end()); }

inline void append_number(Bytes& out, std::uint64_t value, std::size_t size, bool big_endian) {
  for (std::size_t i = 0; i < size; ++i) {
    out.push_back(static_cast<Byte>(value >> (8 * (big_endian ? size - 1 - i : i))));
  }
}

inline Bytes header_bytes(std::uint64_t seconds, std::uint64_t microseconds, std::uint64_t length,
                          bool native64 = false) {
  Bytes out;
  for (const std::uint64_t field : {seconds, microseconds, length}) {
    append_number(out, field, native64 ? 8 : 4, !native64);
  }
  return out;
}

inline Bytes block_bytes(const std::vector<Block>& blocks, bool native64 = false) {
  Bytes out;
  for (const Block& block : blocks) {
    const auto us = static_cast<std::uint64_t>(block.us);
    const Bytes header = header_bytes(us / 1'000'000, us % 1'000'000, block.data.size(), native64);
    out.insert(out.end(), header.begin(), header.end());
    append(out, block.data);
  }
  return out;
}

// Reads flexiport's format as its description says, with nothing of the library.
inline std::vector<Block> decode_independently(const Bytes& bytes) {
  const auto number = [&](std::size_t at) {
    return bytes.at(at) * 16777216LL + bytes.at(at + 1) * 65536LL + bytes.at(at + 2) * 256LL +
           bytes.at(at + 3);
  };
  std::vector<Block> blocks;
  for (std::size_t at = 0; at < bytes.size();) {
    const auto length = static_cast<std::size_t>(number(at + 8));
    Block block{number(at) * 1'000'000 + number(at + 4), {}};
    for (std::size_t i = 0; i < length; ++i) block.data += static_cast<char>(bytes.at(at + 12 + i));
    blocks.push_back(block);
    at += 12 + length;
  }
  return blocks;
}

inline Bytes bytes_of(std::string_view text) { return {text.begin(), text.end()}; }

inline std::unique_ptr<ByteSource> memory(std::string name, Bytes bytes) {
  return std::make_unique<porttape::MemorySource>(std::move(name), std::move(bytes));
}

// "r 26 abc", "w 30 VV", "open 0", "mark 7": a record for comparing; pieces of one block are marked
// "+OFFSET".
inline std::string describe(const Record& record) {
  const std::string time = std::to_string(to_us(record.at));
  if (record.kind != RecordKind::read && record.kind != RecordKind::write) {
    return std::string(name_of(*record.event)) + " " + time;
  }
  std::string text = record.kind == RecordKind::read ? "r " : "w ";
  text += time + " " + to_printable(record.data);
  if (record.data.size() != record.block_length) text += " +" + std::to_string(record.piece_offset);
  return text;
}

// Every record, and last "error: …" if there is one.
inline std::vector<std::string> read_all(RecordSource& source) {
  std::vector<std::string> all;
  for (;;) {
    const auto record = source.next();
    if (!record) {
      all.push_back("error: " + record.error().message);
      return all;
    }
    if (!*record) return all;
    all.push_back(describe(**record));
  }
}

}  // namespace porttape::test
