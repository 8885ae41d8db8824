#pragma once

#include <filesystem>

#include "libport/pack/pack_archive.hpp"

namespace porttape {

// Unpacks a pack into a new folder, which appears when all of it is there and right: names, sizes, digests,
// and each tape of the id and the verdict that it had when it was packed. What the pack keeps from the group
// and from others the folder and its files do, too. Else nothing is there (SIGKILL
// leaves a folder `.NAME.XXXXXX` beside it). Errors as read_pack(), with the pack's name; Errc::usage:
// there is something of the folder's name.
Result<PackManifest> unpack(const std::filesystem::path& pack, const std::filesystem::path& folder,
                            const PackLimits& limits);

}  // namespace porttape
