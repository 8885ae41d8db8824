#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace porttape {

struct CsvCell {
  std::string text;
  std::size_t column = 0;  // of the line where it begins
};

// The cells of a line (RFC 4180, without newlines in them). Nothing: a quote is not closed.
std::optional<std::vector<CsvCell>> csv_cells_of(std::string_view line);

}  // namespace porttape
