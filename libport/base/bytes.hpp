#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace porttape {

using Byte = std::uint8_t;
using Bytes = std::vector<Byte>;
using ByteView = std::span<const Byte>;

// Non-owning view of the characters of a string.
inline ByteView as_bytes(std::string_view text) {
  return {reinterpret_cast<const Byte*>(text.data()), text.size()};
}
inline std::string_view as_text(ByteView bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

inline void append(Bytes& bytes, ByteView more) { bytes.insert(bytes.end(), more.begin(), more.end()); }

inline bool is_line_end(Byte byte) { return byte == '\n' || byte == '\r'; }

// "0a1b": two lower-case digits a byte, no separator.
std::string to_hex(ByteView bytes);

// A digit's value, in either case, and pairs of digits with nothing between them; nothing: these are none.
std::optional<unsigned> hex_digit(char c);
std::optional<Bytes> bytes_of_hex(std::string_view digits);

// Printable ASCII as it is, the rest as \n \r \t \\ \" or \xNN: one line, safe inside double quotes.
std::string to_printable(ByteView bytes);

// `"text"  hex`, as above; of more than `most` bytes the first ones, and "..." behind each.
std::string text_and_hex(ByteView bytes, std::size_t most);

// \n \r \t \\ \" as two characters, what C and JSON write alike; empty for every other byte.
std::string_view short_escape(Byte byte);

}  // namespace porttape
