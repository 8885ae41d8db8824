#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// Tables that Saleae's Logic exports of its serial analyzers, as BINARY.md says.
Result<std::optional<TapeTime>> import_saleae(Evidence& from, ImportTape& to,
                                              const ConvertProgress& progress);
int detect_saleae(std::string_view head);

}  // namespace porttape
