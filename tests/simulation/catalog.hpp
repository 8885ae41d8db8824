#pragma once

#include <string>

#include "tests/simulation/line.hpp"

namespace porttape::simulation {

// The port types of a simulated daemon stand in for those of libport/catalog/port_types.cpp: `memory:NAME`,
// a line of the world, `memorylog:NAME`, which records one, and `logreader`, the real one. The lines are
// those that the world has put up by name.
void put_up(World& world, Line& line);
void take_down_lines();

}  // namespace porttape::simulation
