#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// gdb's `set remotelogfile`, in the bases ascii, hex and octal. It has no times.
Result<std::optional<TapeTime>> import_gdb(Evidence& from, ImportTape& to, const ConvertProgress& progress);
int detect_gdb(std::string_view head);

}  // namespace porttape
