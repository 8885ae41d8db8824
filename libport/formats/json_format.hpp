#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// A JSON object a line: the header of the events file, its events as they are, and blocks, as FORMATS.md
// says. Exact both ways. Also reads what `porttape cat --json` prints.
Result<std::optional<TapeTime>> import_json(Evidence& from, ImportTape& to, const ConvertProgress& progress);
Result<std::vector<std::string>> export_json(TapeReader& from, NewFile& to, const ConvertProgress& progress);
int detect_json(std::string_view head);

}  // namespace porttape
