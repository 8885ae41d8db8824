#pragma once

#include <string>

#include "tests/simulation/hall.hpp"
#include "tests/simulation/line.hpp"

namespace porttape::simulation {

// The port types of a simulated daemon stand in for those of libport/catalog/port_types.cpp: `memory:NAME`,
// a line of the world, `memorylog:NAME`, which records one, and `logreader`, the real one. The lines are
// those that the world has put up by name.
void put_up(World& world, Line& line);
// `memory:NAME,listen` takes its connections, `memory:NAME` is its next device.
void put_up(World& world, Hall& hall);
void take_down_lines();

}  // namespace porttape::simulation
