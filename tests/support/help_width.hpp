#pragma once

#include <algorithm>
#include <sstream>
#include <string>

namespace porttape::test {

// The first line of a help text that does not fit into 80 columns; nothing where all do.
inline std::string first_long_line(const std::string& text) {
  std::istringstream lines(text);
  const auto begins_character = [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) != 0x80U; };
  for (std::string line; std::getline(lines, line);) {
    if (std::ranges::count_if(line, begins_character) > 80) return line;
  }
  return text.empty() ? "there is no text" : "";
}

}  // namespace porttape::test
