#include <cstdlib>
#include <iostream>

#include "tests/simulation/seed.hpp"

int main(int argc, char** argv) {
  const std::uint64_t first = argc > 1 ? std::strtoull(argv[1], nullptr, 10) : 1;
  const std::uint64_t last = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : first;
  const std::filesystem::path folder = "/dev/shm/porttape-sim";
  double seconds = 0;
  int bad = 0;
  for (std::uint64_t seed = first; seed <= last; ++seed) {
    const auto result = porttape::simulation::run_seed(seed, folder, argc > 3);
    seconds += result.seconds;
    for (const auto& line : result.trace) std::cout << line << '\n';
    if (!result.trouble.empty()) {
      std::cout << "seed " << seed << ": " << result.trouble << '\n';
      if (++bad > 20) break;
    }
  }
  std::cout << seconds << " s simulated\n";
}
