#include "libport/formats/saleae_value.hpp"

#include <array>
#include <string>
#include <utility>

#include "libport/base/whole_number.hpp"

namespace porttape {
namespace {

constexpr std::array<std::pair<std::string_view, Byte>, 7> kNamed = {
    {{"COMMA", ','}, {"\\n", '\n'}, {"\\r", '\r'}, {"\\t", '\t'}, {"\\0", 0}, {"\\\\", '\\'}, {"' '", ' '}}};

}  // namespace

std::optional<Byte> saleae_value(std::string_view text, bool decimal) {
  const std::size_t in_brackets = text.rfind(" (");
  if (in_brackets != std::string_view::npos && text.ends_with(')')) {
    text = text.substr(in_brackets + 2);
    text.remove_suffix(1);
    decimal = true;
  }
  if (text.starts_with("0x") || text.starts_with("0X")) return whole_number<Byte>(text.substr(2), 16);
  if (text.starts_with("0b")) {
    std::string digits;
    for (const char c : text.substr(2)) {
      if (c != ' ') digits += c;
    }
    return whole_number<Byte>(digits, 2);
  }
  if (decimal) return whole_number<Byte>(text);
  for (const auto& [name, byte] : kNamed) {
    if (name == text) return byte;
  }
  if (text.size() == 3 && text.front() == '\'' && text.back() == '\'') return static_cast<Byte>(text[1]);
  if (text.size() == 1) return static_cast<Byte>(text.front());
  return std::nullopt;
}

}  // namespace porttape
