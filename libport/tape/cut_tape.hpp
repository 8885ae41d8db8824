#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <variant>

#include "libport/tape/part_writer.hpp"

namespace porttape {

// What of a tape is kept.
struct TimeRange {
  TapeTime from{};
  TapeTime to = TapeTime::max();  // not included
};
struct ExchangeRange {  // from the first write of one to the last record before the write behind the other
  std::uint64_t first = 1;
  std::uint64_t last = std::numeric_limits<std::uint64_t>::max();  // included
};
struct MarkRange {                   // from a mark with this text to the next one with that, both included
  std::optional<std::string> first;  // none: from the tape's begin
  std::optional<std::string> last;   // none: to its end
};
using CutRange = std::variant<TimeRange, ExchangeRange, MarkRange>;

struct CutOptions {
  CutRange range;
  bool rebased = false;  // what comes first is at time 0
  TapeWriterOptions writer;
  TapeProgress progress;
};

struct CutTape {
  TapePaths paths;
  TapeTime from{};  // on the source's time: of the first and the last thing that was kept
  TapeTime to{};
  std::uint64_t blocks = 0;
  std::uint64_t events = 0;                 // without those that are carried
  std::optional<Error> damage_behind = {};  // the source has: the part has no `end`
  std::optional<std::string> half = {};  // why the source is not whole, see TapeReader: the part has no `end`
};

// Makes a tape of a part of another, which is read to its end, since only that tells whether its bytes are
// what was recorded. Errc::usage: there is nothing in the range, with what there is instead;
// else as TapeReader and NewTape.
Result<CutTape> cut_tape(const TapePaths& from, const TapePaths& to, const CutOptions& options);

}  // namespace porttape
