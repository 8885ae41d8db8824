#pragma once

#include <cstdint>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/tape/quantiles.hpp"

namespace porttape {

// How long the driver took between an answer and its next request, and how long it took when recorded. Plain
// value.
struct ThinkTimes {
  std::uint64_t count = 0;
  Micros median{};
  Micros most{};
  std::uint64_t most_at = 0;  // exchange of the tape, 1-based: before its request
  Micros recorded_median{};
  Micros recorded_most{};

  friend bool operator==(const ThinkTimes&, const ThinkTimes&) = default;
};

// Measures them in constant memory: told what the device said, what the driver is to write next, and that it
// did. Plain value.
class ThinkTimer {
 public:
  // What was recorded at `at` was delivered.
  void answered(TapeTime at, Instant now) { answered_ = Answer{at, now}; }
  // The tape's next write: recorded at `at`, up to `end` in the tape's stream of writes.
  void expect(std::uint64_t end, TapeTime at, std::uint64_t exchange);
  // Up to where the driver must have written; nothing where that would tell nothing.
  [[nodiscard]] std::optional<std::uint64_t> expected() const;
  // It has. `rate`: of the replay.
  void came(Instant now, double rate);
  // The answer is not of this session.
  void forget();

  // Nothing where there was none.
  [[nodiscard]] std::optional<ThinkTimes> times() const;

 private:
  struct Answer {
    TapeTime at{};
    Instant real{};
  };
  struct Request {
    std::uint64_t end = 0;
    Answer after;
    TapeTime at{};
    std::uint64_t exchange = 0;
  };

  void add(Nanos real, Nanos recorded, std::uint64_t exchange);

  std::optional<Answer> answered_;
  std::optional<Request> request_;
  Quantiles real_;
  Quantiles recorded_;
  Micros most_{};
  std::uint64_t most_at_ = 0;
};

}  // namespace porttape
