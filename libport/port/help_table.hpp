#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

namespace porttape {

inline constexpr std::size_t kHelpWidth = 80;

// An option and what is said of it.
struct HelpRow {
  std::string left;
  std::string text;
};

// Two columns in lines of at most kHelpWidth characters: the right one is wrapped between words, and begins
// in a line of its own where the left one is long. Words longer than a line stay whole.
std::string help_table(std::span<const HelpRow> rows);

// A text in lines of at most kHelpWidth, those after the first behind `indent` spaces. Line feeds within it
// count as spaces.
std::string help_text(std::string_view text, std::size_t indent = 0);

}  // namespace porttape
