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
