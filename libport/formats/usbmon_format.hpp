#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// Captures of usbmon of a serial adapter, pcap or pcapng, as BINARY.md says.
Result<std::optional<TapeTime>> import_usbmon(Evidence& from, ImportTape& to,
                                              const ConvertProgress& progress);
int detect_usbmon(std::string_view head);

}  // namespace porttape
