#pragma once

#include <string>

#include "libport/replay/excerpt.hpp"
#include "libport/replay/frame_diff.hpp"
#include "libport/replay/paint.hpp"
#include "libport/replay/report.hpp"
#include "libport/replay/roles.hpp"

namespace porttape {

// The frames of both sides, one under the other: hex, text, whose they are. Where one is another, a line of
// marks below tells which bytes: `^^` another, `++` more, `--` less.
std::string diff_text(const TapeExcerpt& excerpt, const std::vector<DiffRow>& rows, const Roles& roles,
                      const Paint& paint);

// The same of a mismatch of which nothing else is known.
std::string diff_text(const Mismatch& mismatch, const Paint& paint);

}  // namespace porttape
