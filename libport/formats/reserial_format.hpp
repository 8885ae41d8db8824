#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// The files of pytest-reserial, as BINARY.md says: what a test's port was sent and what it was answered.
Result<std::optional<TapeTime>> import_reserial(Evidence& from, ImportTape& to,
                                                const ConvertProgress& progress);
Result<std::vector<std::string>> export_reserial(TapeReader& from, NewFile& to,
                                                 const ConvertProgress& progress);
int detect_reserial(std::string_view head);

}  // namespace porttape
