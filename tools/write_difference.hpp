#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// A run of writes and what was answered, up to the next write.
struct WrittenExchange {
  Bytes write;
  Bytes read;

  friend bool operator==(const WrittenExchange&, const WrittenExchange&) = default;
};

// The exchanges of a tape; what came before the first write is one with an empty write. At most `most` bytes
// are read: Errc::usage beyond.
Result<std::vector<WrittenExchange>> read_exchanges(const TapePaths& tape, std::size_t most = 64U << 20U);

// One exchange of both tapes (other bytes written), or of one alone.
struct WriteDifference {
  std::optional<std::size_t> old_number;  // 1-based
  std::optional<std::size_t> new_number;
};

// What was written differently, aligned by equal writes, in order.
std::vector<WriteDifference> compare_writes(const std::vector<WrittenExchange>& old_tape,
                                            const std::vector<WrittenExchange>& new_tape);

}  // namespace porttape
