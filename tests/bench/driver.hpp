#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "libport/base/unique_fd.hpp"

namespace porttape::bench {

// What a driver does to its port again and again.
enum class Act : std::uint32_t {
  round_trip,   // writes and reads the echo
  modem_get,    // TIOCMGET
  modem_clear,  // TIOCMBIC of nothing
  settings,     // TCGETS
  elsewhere,    // TCGETS of /dev/null
  queued,       // FIONREAD, which no supervisor wants
  parent        // getppid()
};
struct Measure {
  Act act = Act::round_trip;
  std::uint32_t size = 16;  // of a round trip, at most 4096
  std::uint32_t warmup = 0;
  std::uint32_t count = 0;
  std::uint32_t calls = 1;  // a time is the mean of so many, for what takes less than a look at the clock
};

// Who has the driver's port: this process, or one that another program runs (porttape exec).
class Driver {
 public:
  virtual ~Driver() = default;
  // The times in µs, `count` of them.
  virtual std::vector<double> take(const Measure& measure) = 0;

  // Does not own the port.
  static std::unique_ptr<Driver> here(int port);
  // That of `linebench drive PORT DIR`, which is there or comes.
  static std::unique_ptr<Driver> elsewhere(const std::filesystem::path& dir);
  // Makes what both need in `dir`.
  static void prepare(const std::filesystem::path& dir);
};

}  // namespace porttape::bench
