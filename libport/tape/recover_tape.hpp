#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "libport/tape/part_writer.hpp"

namespace porttape {

struct RecoverOptions {
  TapeWriterOptions writer;
  TapeProgress progress;
};

struct RecoveredTape {
  TapePaths paths;
  std::uint64_t blocks = 0;
  std::uint64_t events = 0;  // of the source
  std::uint64_t loss_count = 0;
  std::vector<std::string> losses;  // the first 64, each with its file and where in it
  std::vector<std::string> notes;

  [[nodiscard]] bool clean() const { return loss_count == 0; }
};

// Makes a tape of what is sound in another: blocks and events before damage and behind it, of the files that
// are there. A `gap` event stands where something is lost. Errc::usage: no tape, one that is being written;
// Errc::not_a_tape: nothing in it looks like one; else as NewTape.
Result<RecoveredTape> recover_tape(const TapePaths& from, const TapePaths& to, const RecoverOptions& options);

}  // namespace porttape
