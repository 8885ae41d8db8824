#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// Captures of a serial line, LINKTYPE_RTAC_SERIAL, as BINARY.md says: pcapng is exact both ways, pcap holds
// bytes, times, lines and breaks. The importer reads both.
Result<std::optional<TapeTime>> import_rtac(Evidence& from, ImportTape& to, const ConvertProgress& progress);
Result<std::vector<std::string>> export_pcapng(TapeReader& from, NewFile& to,
                                               const ConvertProgress& progress);
Result<std::vector<std::string>> export_rtac(TapeReader& from, NewFile& to, const ConvertProgress& progress);
int detect_pcapng(std::string_view head);
int detect_rtac(std::string_view head);

}  // namespace porttape
