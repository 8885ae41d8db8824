#include "libport/port/help_table.hpp"

#include <algorithm>

namespace porttape {
namespace {

constexpr std::size_t kIndent = 2;
constexpr std::size_t kWidestLeft = 24;

// Characters, of which none of a help text is wider than one.
std::size_t width_of(std::string_view text) {
  return static_cast<std::size_t>(
      std::ranges::count_if(text, [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) != 0x80U; }));
}

// The first word; what is in brackets is one.
std::string_view first_word(std::string_view text) {
  const std::size_t bracket = text.starts_with('[') ? text.find(']') : std::string_view::npos;
  return text.substr(0, text.find(' ', bracket == std::string_view::npos ? 0 : bracket));
}

// Behind what stands in the line, `at` characters; ends it.
void append_wrapped(std::string& out, std::size_t at, std::string_view text, std::size_t indent) {
  bool begun = false;
  while (!text.empty()) {
    const std::string_view word = first_word(text);
    text.remove_prefix(std::min(word.size() + 1, text.size()));
    if (begun && at + 1 + width_of(word) > kHelpWidth) {
      out += '\n' + std::string(indent, ' ');
      at = indent;
    } else if (begun) {
      out += ' ';
      ++at;
    }
    out += word;
    at += width_of(word);
    begun = true;
  }
  out += '\n';
}

}  // namespace

std::string help_table(std::span<const HelpRow> rows) {
  std::size_t left = 0;
  for (const HelpRow& row : rows) {
    if (const std::size_t width = width_of(row.left); width <= kWidestLeft) left = std::max(left, width);
  }
  const std::size_t indent = kIndent + left + 2;
  std::string out;
  for (const HelpRow& row : rows) {
    const std::size_t width = width_of(row.left);
    out += std::string(kIndent, ' ') + row.left;
    if (width > left) {
      out += '\n' + std::string(indent, ' ');
    } else {
      out.append(left + 2 - width, ' ');
    }
    append_wrapped(out, indent, row.text, indent);
  }
  return out;
}

std::string help_text(std::string_view text, std::size_t indent) {
  std::string line(text);
  std::ranges::replace(line, '\n', ' ');
  std::string out;
  append_wrapped(out, 0, std::string_view(line).substr(0, line.find_last_not_of(' ') + 1), indent);
  return out;
}

}  // namespace porttape
