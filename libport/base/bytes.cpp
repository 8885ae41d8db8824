#include "libport/base/bytes.hpp"

#include <algorithm>

namespace porttape {
namespace {

constexpr std::string_view kHexDigits = "0123456789abcdef";

void append_hex(std::string& out, Byte byte) {
  out += kHexDigits[byte >> 4U];
  out += kHexDigits[byte & 0xFU];
}

void append_printable(std::string& out, Byte byte) {
  if (const std::string_view escape = short_escape(byte); !escape.empty()) {
    out += escape;
  } else if (byte >= 0x20 && byte < 0x7F) {
    out += static_cast<char>(byte);
  } else {
    out += "\\x";
    append_hex(out, byte);
  }
}

}  // namespace

std::string_view short_escape(Byte byte) {
  switch (byte) {
    case '\n':
      return "\\n";
    case '\r':
      return "\\r";
    case '\t':
      return "\\t";
    case '\\':
      return "\\\\";
    case '"':
      return "\\\"";
    default:
      return {};
  }
}

std::optional<unsigned> hex_digit(char c) {
  if (c >= '0' && c <= '9') return static_cast<unsigned>(c - '0');
  if (c >= 'a' && c <= 'f') return static_cast<unsigned>(c - 'a') + 10;
  if (c >= 'A' && c <= 'F') return static_cast<unsigned>(c - 'A') + 10;
  return std::nullopt;
}

std::optional<Bytes> bytes_of_hex(std::string_view digits) {
  if (digits.size() % 2 != 0) return std::nullopt;
  Bytes bytes;
  bytes.reserve(digits.size() / 2);
  for (std::size_t i = 0; i < digits.size(); i += 2) {
    const auto high = hex_digit(digits[i]);
    const auto low = hex_digit(digits[i + 1]);
    if (!high || !low) return std::nullopt;
    bytes.push_back(static_cast<Byte>(*high * 16 + *low));
  }
  return bytes;
}

std::string to_hex(ByteView bytes) {
  std::string out;
  out.reserve(bytes.size() * 2);
  for (const Byte byte : bytes) append_hex(out, byte);
  return out;
}

std::string text_and_hex(ByteView bytes, std::size_t most) {
  const ByteView shown = bytes.first(std::min(most, bytes.size()));
  const std::string more = shown.size() < bytes.size() ? "..." : "";
  return '"' + to_printable(shown) + '"' + more + "  " + to_hex(shown) + more;
}

std::string to_printable(ByteView bytes) {
  std::string out;
  out.reserve(bytes.size());
  for (const Byte byte : bytes) append_printable(out, byte);
  return out;
}

}  // namespace porttape
