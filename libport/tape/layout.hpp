#pragma once

#include <optional>

#include "libport/tape/block.hpp"
#include "libport/tape/byte_source.hpp"

namespace porttape {

// Finds the layout both files of a pair are in, from their first 64 KiB and their sizes (FORMAT.md, "Which
// layout"). Either may be null or empty; if both are, it is the big-endian one. Errc::not_a_tape: a file is
// in neither layout, or the two are in different ones. A file that begins as a tape and is damaged further on
// is a tape.
Result<Layout> detect_layout(ByteSource* read, ByteSource* write);

}  // namespace porttape
