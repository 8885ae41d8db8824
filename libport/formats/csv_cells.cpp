#include "libport/formats/csv_cells.hpp"

namespace porttape {

std::optional<std::vector<CsvCell>> csv_cells_of(std::string_view line) {
  std::vector<CsvCell> cells(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    CsvCell& cell = cells.back();
    if (quoted) {
      if (c != '"') {
        cell.text += c;
      } else if (i + 1 < line.size() && line[i + 1] == '"') {
        cell.text += line[++i];
      } else {
        quoted = false;
      }
    } else if (c == '"' && cell.text.empty()) {
      quoted = true;
    } else if (c == ',') {
      cells.push_back({{}, i + 1});
    } else {
      cell.text += c;
    }
  }
  if (quoted) return std::nullopt;
  return cells;
}

}  // namespace porttape
