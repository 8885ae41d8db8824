#pragma once

#include <cstdint>
#include <optional>

#include "libport/base/result.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// The reads of a tape, which can be begun at any of them: where answers are read that were asked for out of
// their order.
class AnswerSource {
 public:
  virtual ~AnswerSource() = default;

  // next() then gives the read whose block begins at `file_offset` (Record::file_offset), with `reads` bytes
  // of reads before it.
  virtual Result<void> seek(std::uint64_t file_offset, std::uint64_t reads) = 0;
  // The next read; nothing at the tape's end.
  virtual Result<std::optional<Record>> next() = 0;
};

}  // namespace porttape
