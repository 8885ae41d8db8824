#pragma once

#include <optional>
#include <string>
#include <vector>

#include "libport/replay/cause.hpp"
#include "libport/replay/excerpt.hpp"
#include "libport/replay/frame_diff.hpp"
#include "libport/replay/roles.hpp"

namespace porttape {

// What a sentence calls a frame of the excerpt: "request 4", "line 2 of request 4".
std::string frame_name(const TapeExcerpt& excerpt, std::size_t step, const Roles& roles);

// Why `came` is not what the tape has from the excerpt's place on. `came` is not empty; `answered`: its first
// frame was answered, so that what does not follow was not to follow.
Cause request_cause(const TapeExcerpt& excerpt, const std::vector<CameFrame>& came, bool answered,
                    const Roles& roles);

}  // namespace porttape
