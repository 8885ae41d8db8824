#pragma once

#include <optional>

#include "libport/replay/give_up.hpp"
#include "libport/replay/report.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// Counts the rest of a tape, as far as it can be read, and what of it is before `start`; nothing when given
// up.
std::optional<TapeTotals> count_tape(RecordSource& tape, const GiveUp& give_up = {}, TapeTime start = {});

}  // namespace porttape
