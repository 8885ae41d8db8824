#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// Bytes without times or directions: the device's to the driver.
Result<std::optional<TapeTime>> import_raw(Evidence& from, ImportTape& to, const ConvertProgress& progress);
// What the device said.
Result<std::vector<std::string>> export_raw(TapeReader& from, NewFile& to, const ConvertProgress& progress);

}  // namespace porttape
