#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// What socat -r FILE -R FILE keep: the evidence is what the driver wrote, what it read is the file that
// options().with names, or that of the same name with R for its last r.
Result<std::optional<TapeTime>> import_socat_raw(Evidence& from, ImportTape& to,
                                                 const ConvertProgress& progress);

}  // namespace porttape
