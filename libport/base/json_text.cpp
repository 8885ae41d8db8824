#include "libport/base/json_text.hpp"

#include <array>
#include <cstddef>

#include "libport/base/bytes.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/utf8.hpp"

namespace porttape {
namespace {

constexpr std::string_view kReplacement = "\xEF\xBF\xBD";

// As \uXXXX; what is obeyed lies below U+10000.
void append_escaped(std::string& out, char32_t character) {
  const std::array<Byte, 2> bytes{static_cast<Byte>(character >> 8U), static_cast<Byte>(character & 0xFFU)};
  out += "\\u" + to_hex(bytes);
}

}  // namespace

std::string to_utf8(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    out += length == 0 ? kReplacement : text.substr(0, length);
    text.remove_prefix(length == 0 ? 1 : length);
  }
  return out;
}

std::string json_quote(std::string_view text) {
  std::string out = "\"";
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    const std::string_view sequence = text.substr(0, length);
    const std::string_view escape = short_escape(static_cast<Byte>(text.front()));
    text.remove_prefix(length == 0 ? 1 : length);
    if (length == 0) {
      out += kReplacement;
    } else if (!escape.empty()) {
      out += escape;
    } else if (const char32_t character = utf8_character(sequence); is_obeyed(character)) {
      append_escaped(out, character);
    } else {
      out += sequence;
    }
  }
  out += '"';
  return out;
}

std::string json_for_terminal(std::string_view json) {
  std::string out;
  out.reserve(json.size());
  while (!json.empty()) {
    const std::size_t length = utf8_length(json);
    const std::string_view sequence = json.substr(0, length);
    json.remove_prefix(length == 0 ? 1 : length);
    const char32_t character = length == 0 ? U'\uFFFD' : utf8_character(sequence);
    if (character < 0x20) {
      out += ' ';  // between the strings, where alone JSON has it
    } else if (is_obeyed(character)) {
      append_escaped(out, character);
    } else {
      out += length == 0 ? kReplacement : sequence;
    }
  }
  return out;
}

}  // namespace porttape
