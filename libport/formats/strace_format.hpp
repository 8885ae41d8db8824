#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// What strace saw a program do with its device, as FORMATS.md says.
Result<std::optional<TapeTime>> import_strace(Evidence& from, ImportTape& to,
                                              const ConvertProgress& progress);
int detect_strace(std::string_view head);

}  // namespace porttape
