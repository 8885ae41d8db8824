#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// Sessions of sigrok (a zip of samples), as BINARY.md says: a tape as the levels of its two lines, and what a
// UART makes of captured levels.
Result<std::optional<TapeTime>> import_sr(Evidence& from, ImportTape& to, const ConvertProgress& progress);
Result<std::vector<std::string>> export_sr(TapeReader& from, NewFile& to, const ConvertProgress& progress);
// At a speed where the tape tells none.
Result<std::vector<std::string>> export_sr_at(TapeReader& from, NewFile& to, std::optional<unsigned> bytes_at,
                                              const ConvertProgress& progress);
int detect_sr(std::string_view head);

}  // namespace porttape
