#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "libport/tape/event.hpp"
#include "tests/simulation/line.hpp"
#include "tests/simulation/world.hpp"

namespace porttape::simulation {

// An event of a tape, and how many bytes of each direction come before it.
struct TapeStep {
  std::string what;
  std::uint64_t read = 0;
  std::uint64_t written = 0;
  // A step that the tape must have is neither optional nor carried.
  bool optional = false;  // the documents leave it open
  bool carried = false;   // at the beginning of a later tape, where what held before may be said again
};

// The text by which events of the device's port and of the tape are compared: without times and reasons.
// Empty for events that are not compared (gaps, marks, the end).
std::string step_text(const Event& event);

// Compares the events of a channel's tapes with the log of its device's port, by the rules of
// libport/tape/FORMAT.md. Unless `whole`, a disk may have lost some, and their places are not compared.
void check_tape_steps(World& world, const std::string& name, const Line& device,
                      const std::vector<TapeStep>& taped, bool whole);

}  // namespace porttape::simulation
