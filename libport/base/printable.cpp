#include "libport/base/printable.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <fmt/format.h>

#include "libport/base/bytes.hpp"
#include "libport/base/utf8.hpp"

namespace porttape {

bool is_obeyed(char32_t character) {
  const auto within = [&](char32_t first, char32_t last) { return character >= first && character <= last; };
  return character < 0x20 || within(0x7F, 0x9F) ||          // C0, DEL, C1
         character == 0x061C || within(0x200E, 0x200F) ||   // marks of direction
         within(0x2028, 0x2029) ||                          // separators of lines and paragraphs
         within(0x202A, 0x202E) || within(0x2066, 0x2069);  // embeddings, overrides, isolates
}

namespace {

void append_character(std::string& out, char32_t character) {
  const std::string_view escape = character < 0x80 ? short_escape(static_cast<Byte>(character)) : "";
  if (!escape.empty()) {
    out += escape;
    return;
  }
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), character < 0x100 ? "\\x%02x" : "\\u{%04x}",
                static_cast<unsigned>(character));
  out += text.data();
}

std::string printable(std::string_view text, bool keep_lines) {
  std::string out;
  out.reserve(text.size());
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    const std::string_view sequence = text.substr(0, length);
    const auto byte = static_cast<Byte>(text.front());
    text.remove_prefix(length == 0 ? 1 : length);
    if (length == 0) {
      append_character(out, byte);
    } else if (keep_lines && byte == '\n') {
      out += text.empty() || text.front() == ' ' ? "\n" : "\n  ";
    } else if (const char32_t character = utf8_character(sequence); is_obeyed(character)) {
      append_character(out, character);
    } else {
      out += sequence;
    }
  }
  return out;
}

}  // namespace

std::string printable_line(std::string_view text) { return printable(text, false); }

std::string in_quotes(std::string_view name) { return "'" + printable(name, false) + "'"; }

std::string shell_word(std::string_view word) {
  constexpr std::string_view plain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_./:,=+@%{}";
  // A shell makes several words of {a,b} and {a..b}.
  const bool expands =
      word.find('{') != std::string_view::npos &&
      (word.find(',') != std::string_view::npos || word.find("..") != std::string_view::npos);
  if (!word.empty() && !expands && word.find_first_not_of(plain) == std::string_view::npos)
    return std::string(word);
  if (printable_line(word) == word) {
    std::string quoted = "'";
    for (const char c : word) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
    return quoted + "'";
  }
  std::string quoted = "$'";
  for (const char c : word) {
    const auto code = static_cast<unsigned char>(c);
    if (code < 0x20 || code >= 0x7f || c == '\'' || c == '\\') {
      quoted += fmt::format("\\{:03o}", code);
    } else {
      quoted += c;
    }
  }
  return quoted + "'";
}

std::string printable_lines(std::string_view text) { return printable(text, true); }

}  // namespace porttape
