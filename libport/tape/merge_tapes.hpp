#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "libport/tape/part_writer.hpp"

namespace porttape {

struct MergeOptions {
  // When each tape but the first begins, on the time of the first (it may be before it); empty: by their
  // clocks, else one after the other.
  std::vector<Micros> offsets;
  TapeWriterOptions writer;
  TapeProgress progress;
};

struct MergedTape {
  enum class Placed : std::uint8_t {
    clock,  // by the clock of the boot in which all were recorded
    parts,  // as the tape that they are split of
    given,
    after  // one after the other
  };
  TapePaths paths;
  Placed placed = Placed::after;
  std::uint64_t blocks = 0;
  std::uint64_t events = 0;
  TapeTime end{};
  std::vector<std::string> halves = {};  // why sources are not whole, see TapeReader: the tape has no `end`
};

// Makes one tape of several, in the order of FORMAT.md; what is equal in time comes in the order in which
// they are given. Its zero is that of the earliest one, whose header it has. What a tape carries and what
// held on the line already is left out. Errors as TapeReader and NewTape; Errc::usage: a tape is given twice,
// or not as many offsets.
Result<MergedTape> merge_tapes(const std::vector<TapePaths>& tapes, const TapePaths& to,
                               const MergeOptions& options);

}  // namespace porttape
