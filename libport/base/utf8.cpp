#include "libport/base/utf8.hpp"

#include "libport/base/bytes.hpp"

namespace porttape {

std::size_t utf8_length(std::string_view text) {
  const auto byte = [&](std::size_t i) { return i < text.size() ? static_cast<Byte>(text[i]) : Byte{0}; };
  const auto tail = [&](std::size_t i) { return (byte(i) & 0xC0U) == 0x80U; };
  const Byte first = byte(0);
  const Byte second = byte(1);
  if (first < 0x80) return 1;
  if (first >= 0xC2 && first <= 0xDF) return tail(1) ? 2 : 0;
  if (first >= 0xE0 && first <= 0xEF) {
    const bool overlong = first == 0xE0 && second < 0xA0;
    const bool surrogate = first == 0xED && second > 0x9F;
    return tail(1) && tail(2) && !overlong && !surrogate ? 3 : 0;
  }
  if (first >= 0xF0 && first <= 0xF4) {
    const bool overlong = first == 0xF0 && second < 0x90;
    const bool too_large = first == 0xF4 && second > 0x8F;
    return tail(1) && tail(2) && tail(3) && !overlong && !too_large ? 4 : 0;
  }
  return 0;
}

char32_t utf8_character(std::string_view text) {
  const auto first = static_cast<Byte>(text.front());
  if (text.size() == 1) return first;
  // The first byte's own bits: 5, 4 or 3 of them.
  char32_t character = first & (0x7FU >> text.size());
  for (const char c : text.substr(1)) character = (character << 6U) | (static_cast<Byte>(c) & 0x3FU);
  return character;
}

}  // namespace porttape
