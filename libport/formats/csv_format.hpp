#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// A table with the columns seconds, kind and data, as FORMATS.md says. Exact both ways; columns of other
// names and in another order are read too. Of a block there may be 64 MiB.
Result<std::optional<TapeTime>> import_csv(Evidence& from, ImportTape& to, const ConvertProgress& progress);
Result<std::vector<std::string>> export_csv(TapeReader& from, NewFile& to, const ConvertProgress& progress);
int detect_csv(std::string_view head);

}  // namespace porttape
