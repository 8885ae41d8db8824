#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "libport/tape/part_writer.hpp"

namespace porttape {

struct SplitOptions {
  enum class At : std::uint8_t {
    session,  // at each open but the first
    mark,     // at each mark
    every,    // at each multiple of `span`
    gap       // where nothing is for so long
  };
  At at = At::session;
  Micros span{};
  TapeWriterOptions writer;
  TapeProgress progress;
};

struct SplitPart {
  TapeTime from{};  // on the source's time: of its zero, and of its last record
  TapeTime to{};
  std::uint64_t blocks = 0;
  std::uint64_t events = 0;  // without those that are carried
  std::optional<std::string> half =
      {};  // of all parts: why the source is not whole; none of them has an `end`
};

// Makes tapes of the parts of a tape, part_tape(to, 1) and so on: each record is in one of them. Each part's
// zero is its own beginning, the first one's that of the tape, and each knows the one before it. They appear
// together when all are whole (TapeSet). Errors as TapeReader, NewTape and TapeSet; Errc::usage: the tape is
// empty.
Result<std::vector<SplitPart>> split_tape(const TapePaths& from, const TapePaths& to,
                                          const SplitOptions& options);

}  // namespace porttape
