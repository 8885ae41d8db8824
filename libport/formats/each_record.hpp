#pragma once

#include <cstdint>

#include "libport/formats/format.hpp"
#include "libport/tape/part_writer.hpp"

namespace porttape {

// Gives the records of a tape to `see`, Result<void>(const Record&), in order, and tells how far it is. Stops
// at the first error.
template <class See>
Result<void> each_record(TapeReader& tape, const ConvertProgress& progress, See&& see) {
  std::uint64_t bytes = 0;
  for (;;) {
    const auto next = tape.next();
    if (!next) return next.error();
    if (!*next) return {};
    if (Result<void> seen = see(**next); !seen) return seen;
    if (progress) progress(bytes += bytes_in_file(**next));
  }
}

}  // namespace porttape
