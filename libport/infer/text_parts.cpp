#include "libport/infer/text_parts.hpp"

#include <algorithm>
#include <array>
#include <fmt/format.h>

namespace porttape {
namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }
bool is_word(char c) { return is_digit(c) || is_letter(c) || c == '.' || c == '_' || c == '+' || c == '-'; }
bool is_number(char c) { return is_digit(c) || c == '.' || c == '+' || c == '-'; }
bool is_lower_hex(char c) { return is_digit(c) || (c >= 'a' && c <= 'f'); }
bool is_upper_hex(char c) { return is_digit(c) || (c >= 'A' && c <= 'F'); }
bool is_hex(char c) { return is_lower_hex(c) || is_upper_hex(c); }
bool is_any(char) { return true; }

struct ClassRow {
  bool (*has)(char);
  std::string_view regex;
};
// By TextClass.
constexpr std::array<ClassRow, 7> kClasses{{{is_digit, "[0-9]"},
                                            {is_number, "[-+.0-9]"},
                                            {is_lower_hex, "[0-9a-f]"},
                                            {is_upper_hex, "[0-9A-F]"},
                                            {is_hex, "[0-9A-Fa-f]"},
                                            {is_word, "[-+._0-9A-Za-z]"},
                                            {is_any, "[^\\r\\n]"}}};

const ClassRow& row_of(TextClass made_of) { return kClasses.at(static_cast<std::size_t>(made_of)); }

std::size_t leading_digits(std::string_view text) {
  return static_cast<std::size_t>(std::ranges::find_if_not(text, is_digit) - text.begin());
}
std::size_t trailing_digits(std::string_view text) {
  const auto from = text.find_last_not_of("0123456789");
  return text.size() - (from == std::string_view::npos ? 0 : from + 1);
}

std::size_t common_prefix(std::span<const std::string_view> texts) {
  std::size_t size = texts.front().size();
  for (const std::string_view text : texts) {
    const auto [mine, other] = std::ranges::mismatch(texts.front().substr(0, size), text);
    size = static_cast<std::size_t>(mine - texts.front().begin());
  }
  return size;
}

std::size_t common_suffix(std::span<const std::string_view> texts, std::size_t prefix) {
  std::size_t size = texts.front().size() - prefix;
  for (const std::string_view text : texts) {
    size = std::min(size, text.size() - prefix);
    std::size_t same = 0;
    while (same < size && text[text.size() - 1 - same] == texts.front()[texts.front().size() - 1 - same])
      ++same;
    size = same;
  }
  return size;
}

// How much of the end is "12." or "12.5", and how much of the begin ".5" or "1.5".
std::size_t digits_and_point(std::string_view text) {
  const std::size_t fraction = trailing_digits(text);
  const std::string_view rest = text.substr(0, text.size() - fraction);
  if (!rest.ends_with('.')) return 0;
  const std::size_t whole = trailing_digits(rest.substr(0, rest.size() - 1));
  return whole > 0 ? whole + 1 + fraction : 0;
}
std::size_t point_and_digits(std::string_view text) {
  const std::size_t whole = leading_digits(text);
  if (!text.substr(whole).starts_with('.')) return 0;
  const std::size_t fraction = leading_digits(text.substr(whole + 1));
  return fraction > 0 ? whole + 1 + fraction : 0;
}

// Zeros that fill a number up show that its size stays.
bool is_padded(std::span<const std::string_view> texts) {
  const std::size_t size = texts.front().size();
  return size > 1 && std::ranges::all_of(texts, [&](auto text) { return text.size() == size; }) &&
         std::ranges::any_of(texts, [](auto text) { return text.front() == '0' && text[1] != '.'; });
}

}  // namespace

TextParts cut_text(std::string_view text) {
  TextParts parts;
  std::size_t begin = 0;
  for (std::size_t at = 0; at < text.size(); ++at) {
    if (is_word(text[at])) continue;
    parts.words.push_back(text.substr(begin, at - begin));
    parts.marks += text[at];
    begin = at + 1;
  }
  parts.words.push_back(text.substr(begin));
  return parts;
}

TextClass class_of(std::span<const std::string_view> texts) {
  for (std::size_t i = 0; i < kClasses.size(); ++i) {
    const bool all = std::ranges::all_of(
        texts, [&](std::string_view text) { return std::ranges::all_of(text, kClasses[i].has); });
    if (all) return static_cast<TextClass>(i);
  }
  return TextClass::any;
}

bool WordPattern::matches(std::string_view word) const {
  if (word.size() < before.size() + behind.size() || !word.starts_with(before) || !word.ends_with(behind))
    return false;
  const std::string_view middle = free_part(word);
  if (middle.empty() ? !may_be_empty : fixed_size > 0 && middle.size() != fixed_size) return false;
  return std::ranges::all_of(middle, row_of(made_of).has);
}

WordPattern find_pattern(std::span<const std::string_view> words) {
  const std::string_view first = words.front();
  std::size_t prefix = common_prefix(words);
  std::size_t suffix = common_suffix(words, prefix);
  std::vector<std::string_view> middles;
  const auto cut = [&] {
    middles.clear();
    for (const std::string_view word : words)
      middles.push_back(word.substr(prefix, word.size() - prefix - suffix));
  };
  cut();
  WordPattern pattern;
  pattern.made_of = class_of(middles);
  const std::size_t point_before =
      pattern.made_of <= TextClass::number ? digits_and_point(first.substr(0, prefix)) : 0;
  const std::size_t point_behind =
      pattern.made_of <= TextClass::number ? point_and_digits(first.substr(first.size() - suffix)) : 0;
  if (point_before + point_behind > 0) pattern.made_of = TextClass::number;
  prefix -= point_before;
  suffix -= point_behind;
  const auto has = pattern.made_of == TextClass::number ? is_digit : row_of(pattern.made_of).has;
  const bool whole = pattern.made_of < TextClass::word;  // a number
  while (whole && prefix > 0 && has(first[prefix - 1])) --prefix;
  while (whole && suffix > 0 && has(first[first.size() - suffix])) --suffix;
  cut();
  pattern.before = first.substr(0, prefix);
  pattern.behind = first.substr(first.size() - suffix);
  pattern.may_be_empty = std::ranges::any_of(middles, &std::string_view::empty);
  if (pattern.made_of < TextClass::word && !pattern.may_be_empty && is_padded(middles))
    pattern.fixed_size = middles.front().size();
  return pattern;
}

std::string regex_of(const WordPattern& pattern) {
  const std::string_view made_of = row_of(pattern.made_of).regex;
  if (pattern.fixed_size > 0) return fmt::format("{}{{{}}}", made_of, pattern.fixed_size);
  return fmt::format("{}{}", made_of, pattern.may_be_empty ? '*' : '+');
}

}  // namespace porttape
