#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// The editable text of a tape, as FORMATS.md says: blocks and events with their times, exact both ways. Of a
// block there may be 64 MiB.
Result<std::optional<TapeTime>> import_text(Evidence& from, ImportTape& to, const ConvertProgress& progress);
Result<std::vector<std::string>> export_text(TapeReader& from, NewFile& to, const ConvertProgress& progress);
int detect_text(std::string_view head);

}  // namespace porttape
