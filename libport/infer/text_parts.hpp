#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace porttape {

// A line of text cut at what is no letter, digit or one of `._+-`: words, some of them empty, with one such
// character between each two.
struct TextParts {
  std::vector<std::string_view> words;  // one more than
  std::string marks;                    // what stands between them
};
TextParts cut_text(std::string_view text);

// What all of some texts are made of, from the narrowest class to the widest.
enum class TextClass { digits, number, lower_hex, upper_hex, hex, word, any };
TextClass class_of(std::span<const std::string_view> texts);

// What of a word differs between sessions: `before`, then characters of the class, then `behind`.
struct WordPattern {
  std::string before;
  std::string behind;
  TextClass made_of = TextClass::any;
  std::size_t fixed_size = 0;  // of the part that differs; 0: any size
  bool may_be_empty = false;

  [[nodiscard]] bool matches(std::string_view word) const;
  // The part that differs.
  [[nodiscard]] std::string_view free_part(std::string_view word) const {
    return word.substr(before.size(), word.size() - before.size() - behind.size());
  }
  friend bool operator==(const WordPattern&, const WordPattern&) = default;
};

// The narrowest pattern for these words, which are not all alike. A number is taken whole: also the digits
// that happen to be the same in all.
WordPattern find_pattern(std::span<const std::string_view> words);

// "[0-9]+": the class and the size of the part that differs, as a regular expression.
std::string regex_of(const WordPattern& pattern);

}  // namespace porttape
