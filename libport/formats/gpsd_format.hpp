#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// A log for gpsd's tests and gpsfake: lines of comment, and what the receiver said.
Result<std::optional<TapeTime>> import_gpsd(Evidence& from, ImportTape& to, const ConvertProgress& progress);
Result<std::vector<std::string>> export_gpsd(TapeReader& from, NewFile& to, const ConvertProgress& progress);
int detect_gpsd(std::string_view head);

}  // namespace porttape
