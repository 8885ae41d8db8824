#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "libport/pack/pack_archive.hpp"
#include "libport/tape/part_writer.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// What a pack is made of.
struct PackOptions {
  bool overwrite = false;
  PackManifest about{};                              // driver and system; the rest is filled in
  std::optional<std::filesystem::path> redaction{};  // a report of porttape redact
  TapeProgress progress{};
};

// zstd, or gzip where the file's name ends in .gz or .tgz.
PackFormat pack_format_of(const std::filesystem::path& file);

// Makes one file of tapes, each of whose files is in it byte for byte, and of what is told about them. It
// appears whole, or not at all. A damaged tape is packed as it is, and its verdict says so. Errc::usage: a
// name that is taken, two tapes of one name, a tape that is being written; Errc::io; else as summarize().
Result<PackManifest> make_pack(const std::vector<TapePaths>& tapes, const std::filesystem::path& file,
                               const PackOptions& options);

}  // namespace porttape
