#pragma once

#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_writer.hpp"

namespace porttape {

// Whether the files of a new tape can be made: see TapeWriter::check().
Result<void> check_tape_files(const TapePaths& paths, bool overwrite);

// Makes the three files, new and empty; where `overwrite` is set, existing regular files are unlinked first.
// An error leaves no new file behind. Errc::usage as check_tape_files(), Errc::io.
Result<TapeSinks> create_tape_files(const TapePaths& paths, bool overwrite);

}  // namespace porttape
