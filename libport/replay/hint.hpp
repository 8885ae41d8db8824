#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "libport/base/bytes.hpp"
#include "libport/replay/give_up.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// Says whether `got`, which was not what the tape expects at `offset` of its write stream, stands elsewhere
// on it: "already consumed at offset N (tape T s)", "comes later at offset N (tape T s)", both (the nearest
// of each), or nothing (an empty text).
//
// Looks for up to 16 bytes of `got`, in 16 MiB either side; reads all that stands before. Rewinds `writes`
// and leaves it anywhere; an error of it means no hint. Nothing at all when given up.
std::optional<std::string> find_hint(RecordSource& writes, std::uint64_t offset, ByteView got,
                                     const GiveUp& give_up = {});

}  // namespace porttape
