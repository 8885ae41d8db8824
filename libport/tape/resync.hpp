#pragma once

#include <cstdint>
#include <optional>

#include "libport/tape/block.hpp"
#include "libport/tape/byte_source.hpp"

namespace porttape {

// Tells a corrupted length in mid-file from a torn tail: looks behind the header of a block that reaches past
// the end of the file for a chain of plausible blocks (FORMAT.md, "Torn tail or damage"). Gives where the
// chain starts, nothing for a torn tail. Bounded in time and memory, whatever the file holds.
//
// `from`: where the block's payload starts; `not_before_us`: the block's time.
Result<std::optional<std::uint64_t>> find_block_chain(ByteSource& source, Layout layout, std::uint64_t from,
                                                      std::uint64_t file_size, std::int64_t not_before_us);

}  // namespace porttape
