#pragma once

#include <chrono>
#include <cstdint>
#include <limits>
#include <optional>

#include "libport/base/clock.hpp"

namespace porttape::simulation {

// Chance from a seed, the same with every library (SplitMix64). The seed is mixed first: neighbouring
// multiples of the step below would give one sequence, each a number further on.
class Random {
 public:
  using result_type = std::uint64_t;
  explicit Random(std::uint64_t seed) : state_(mixed(seed + kStep)) {}
  static constexpr result_type min() { return 0; }
  static constexpr result_type max() { return std::numeric_limits<result_type>::max(); }
  result_type operator()() { return mixed(state_ += kStep); }

 private:
  static constexpr std::uint64_t kStep = 0x9e3779b97f4a7c15U;
  static constexpr std::uint64_t mixed(std::uint64_t z) {
    z = (z ^ (z >> 30U)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27U)) * 0x94d049bb133111ebU;
    return z ^ (z >> 31U);
  }

  std::uint64_t state_;
};

// What stands in for the system while a seed runs: its clock, its threads, its timers and its disk.
//
// The program under it is the real one, with its real loop and its real worker threads. The loop is given the
// kernel as its clock. Of the C library only the functions by which the program would wait are replaced, and
// the clock's for those who ask the machine (Asio, the log, worker threads) (c_library.cpp, disk.cpp), for
// the whole process, while a Kernel exists: the clock stands still but for a tick each time it is read,
// threads are coroutines of which one runs until it waits, and when all wait the clock goes to the first
// moment that one waits for. The seed decides who goes on. So a seed does the same each time, and hours pass
// in milliseconds.
//
// One at a time; nothing else runs in the process meanwhile.
class Kernel final : public Clock {
 public:
  using Moment = std::chrono::nanoseconds;  // since the seed's start

  explicit Kernel(std::uint64_t seed);
  ~Kernel() override;  // when all threads have ended: run_down()

  // What the program reads: it costs a tick, and other threads may come first.
  [[nodiscard]] Instant now() const override;
  [[nodiscard]] WallTime wall() const override;
  [[nodiscard]] std::optional<Instant> machine_time(Instant when) const override { return when; }
  // Since the seed's start; free.
  [[nodiscard]] Moment passed() const;
  // How often the loop was woken, by whatever it waits for.
  [[nodiscard]] std::uint64_t wake_ups() const;
  // Waits as a slow call does: the others go on.
  void sleep(Moment time);
  // Whether it is called by one of the program's worker threads.
  [[nodiscard]] bool on_worker() const;
  // Lets the other threads end, which may take simulated time. False: some never do.
  bool run_down();
  // Threads that were not to be had from now on (EAGAIN).
  void refuse_threads(bool refused);
  // The wall clock is set.
  void step_clock(Moment by);

  Random& random();
  // The one that exists; null outside a seed.
  static Kernel* current();

  struct Parts;

 private:
  Parts* parts_;
};

// Nothing will ever happen again, and the program waits: thrown out of the loop.
struct WaitsForEver {};

}  // namespace porttape::simulation
