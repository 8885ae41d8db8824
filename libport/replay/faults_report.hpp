#pragma once

#include <string>

#include "libport/replay/report.hpp"

namespace porttape {

// One line: `2 made (1 corrupt, 1 drop) by drop:p=0.01:dir=r; seed 7`.
std::string to_text(const FaultsReport& faults);
// The key `faults` of a report.
std::string to_json(const FaultsReport& faults);

}  // namespace porttape
