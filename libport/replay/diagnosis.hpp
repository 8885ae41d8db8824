#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "libport/replay/cause.hpp"
#include "libport/replay/excerpt.hpp"
#include "libport/replay/frame_diff.hpp"

namespace porttape {

struct RunReport;

// What a report adds to what is wrong: why, and the frames of both sides. Plain value.
struct Diagnosis {
  std::optional<Cause> cause;
  // Data and extra: from the frame on in which the difference is.
  std::vector<DiffRow> rows;
};

// Where on the tape's stream of writes the report's fault is; nothing where it has none to look at.
std::optional<std::uint64_t> place_of_fault(const RunReport& report);

// What came from the beginning of the tape's frame on in which the difference is.
Bytes came_from_frame(const RunReport& report, const TapeExcerpt& excerpt);

// What the tape has as the answer to the request that came first, where that is one of another place; nothing
// where it is none, or has no answer of its own.
std::optional<Bytes> answer_elsewhere(const TapeExcerpt& excerpt, ByteView came);

// Fills the report's diagnosis, from its excerpt above all. Again where the report has been told more.
void diagnose(RunReport& report);

}  // namespace porttape
