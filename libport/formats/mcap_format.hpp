#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// MCAP, as BINARY.md says: exact both ways.
Result<std::optional<TapeTime>> import_mcap(Evidence& from, ImportTape& to, const ConvertProgress& progress);
Result<std::vector<std::string>> export_mcap(TapeReader& from, NewFile& to, const ConvertProgress& progress);
int detect_mcap(std::string_view head);

}  // namespace porttape
