#pragma once

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>

#include "libport/base/bytes.hpp"
#include "libport/base/unique_fd.hpp"

namespace porttape::bench {

// What a person is told; main() prints it and exits with 1.
class BenchError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// A wrong command line: exit 2.
class UsageError : public BenchError {
 public:
  using BenchError::BenchError;
};

// SIGINT or SIGTERM came while waiting.
class Interrupted : public BenchError {
 public:
  explicit Interrupted(int signal) : BenchError("interrupted"), signal_number(signal) {}
  int signal_number;
};

[[noreturn]] void throw_errno(const std::string& what);

// Makes SIGINT, SIGTERM and the watchdog end blocking calls (EINTR), after which check_signals() throws.
void install_signal_handlers();
void check_signals();

// Throws from a blocking call of this thread when `seconds` have passed: no measurement hangs on a line that
// lost a byte.
class Watchdog {
 public:
  Watchdog(unsigned seconds, std::string what);
  ~Watchdog();
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;
};

// CLOCK_MONOTONIC in nanoseconds.
std::int64_t now_ns();
void sleep_ms(int ms);

struct Pty {
  UniqueFd master;
  std::string slave;  // its path
};

Pty make_pty();                               // raw, no echo
UniqueFd open_port(const std::string& path);  // blocking, raw if it is a terminal

// Blocking, EINTR-safe. read_some gives 0 at the end of the line (hang-up).
std::size_t read_some(int fd, Byte* data, std::size_t size);
void read_exact(int fd, Byte* data, std::size_t size);
void write_all(int fd, const Byte* data, std::size_t size);

}  // namespace porttape::bench
