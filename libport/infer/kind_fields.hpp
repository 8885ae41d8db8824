#pragma once

#include <span>
#include <vector>

#include "libport/infer/findings.hpp"
#include "libport/infer/frame_kinds.hpp"

namespace porttape {

// The counters that go through all frames of a sort.
void find_sort_counters(FoundSort& sort, std::span<const FrameRun> runs);
// Of these, those that differ between sessions.
void keep_differing_counters(FoundSort& sort, std::span<const Compared> columns);

// What differs between the frames of a kind, beside the sort's checksum, length and counters.
void find_fields(const FoundSort& sort, KindColumns& kind);

}  // namespace porttape
