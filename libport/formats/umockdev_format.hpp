#pragma once

#include "libport/formats/format.hpp"

namespace porttape {

// A script of umockdev, as umockdev-record --script writes it and umockdev-run plays it: to its millisecond.
Result<std::optional<TapeTime>> import_umockdev(Evidence& from, ImportTape& to,
                                                const ConvertProgress& progress);
Result<std::vector<std::string>> export_umockdev(TapeReader& from, NewFile& to,
                                                 const ConvertProgress& progress);
int detect_umockdev(std::string_view head);

}  // namespace porttape
