#pragma once

#include "libport/replay/cause.hpp"
#include "libport/replay/excerpt.hpp"
#include "libport/replay/frame_diff.hpp"

namespace porttape {

// What makes `came` another frame than the tape's at `step`: one byte more, its line end, its checksum, …
// `what` is what a sentence calls that frame ("request 4").
Cause edit_cause(const TapeExcerpt& excerpt, std::size_t step, const CameFrame& came,
                 const std::string& what);

}  // namespace porttape
