#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/replay/excerpt.hpp"

namespace porttape {

// What came instead of the tape's frames, cut as those are. Plain value.
struct CameFrame {
  Bytes bytes;
  bool open_end = false;  // the last one: more of it may have followed
};

// Cuts what came from the place of the excerpt on: where a frame of the tape stands whole, else at the ends
// of lines, or where the next frame of the tape begins.
std::vector<CameFrame> cut_came(const TapeExcerpt& excerpt, ByteView came);

// Whether at least half of its bytes are the frame's, in their order.
bool resembles(const TapeFrame& frame, const CameFrame& came);

// One line of a comparison. `step` is the tape's (an index of the excerpt's), `came` what came.
struct DiffRow {
  enum class Op : std::uint8_t { same, changed, left_out, added };
  Op op = Op::same;
  std::optional<std::size_t> step;
  std::optional<CameFrame> came;
};

// What came beside what the tape has from its place on, at the fewest costs: a frame that stands elsewhere in
// the excerpt is sooner added or left out than changed into another. Ends with the last that came.
std::vector<DiffRow> align_frames(const TapeExcerpt& excerpt, const std::vector<CameFrame>& came);

}  // namespace porttape
