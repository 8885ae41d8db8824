#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// What socat -x, -v or both tell, `>` as the driver's writes. What -v alone has as a dot is lost.
Result<std::optional<TapeTime>> import_socat(Evidence& from, ImportTape& to, const ConvertProgress& progress);
int detect_socat(std::string_view head);

}  // namespace porttape
