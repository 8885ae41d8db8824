#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace porttape::simulation {

// What became of a seed.
struct SeedResult {
  std::string trouble;  // what was wrong; empty: nothing
  double seconds = 0;   // simulated
  std::vector<std::string> trace;
};

// Runs a whole daemon through the events that the seed stands for, and checks what must hold. Makes and
// empties `folder`.
SeedResult run_seed(std::uint64_t seed, const std::filesystem::path& folder, bool tracing);

}  // namespace porttape::simulation
