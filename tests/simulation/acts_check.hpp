#pragma once

#include <string>

#include "tests/simulation/line.hpp"
#include "tests/simulation/world.hpp"

namespace porttape::simulation {

// Whether the acts of a driver (signals, settings, flushes, drains, questions) have reached its device as
// README.md says, by what both ports have logged; and the device's signals the driver. `exact`: no fault of
// `--faults` holds bytes back or breaks the line. From `end` on the daemon may drop bytes.
void check_acts(World& world, const std::string& name, const Line& driver, const Line& device, bool exact,
                Instant end);

}  // namespace porttape::simulation
