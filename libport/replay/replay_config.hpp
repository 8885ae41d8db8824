#pragma once

#include <cstdint>

#include "libport/base/time.hpp"

namespace porttape {

enum class Timing : std::uint8_t { reactive, recorded, none };
enum class OnMismatch : std::uint8_t { fail, warn };
enum class AtEnd : std::uint8_t { idle, hangup, exit };
enum class OnReopen : std::uint8_t { automatic, rewind, continue_ };
enum class Chunks : std::uint8_t { automatic, recorded, burst };

// The replay options of contract section 4, with the defaults of the verb `replay`.
struct ReplayConfig {
  int strictness = 1;         // 0 writes not checked, 1 data, 2 data and timing
  Micros jitter{100'000};     // strictness 2: margin early and late, in real time
  bool late_allowed = false;  // strictness 2: only early writes are timing mismatches
  Timing timing = Timing::reactive;
  double rate = 1.0;  // > 0; time runs this many times as fast
  OnMismatch on_mismatch = OnMismatch::warn;
  AtEnd at_end = AtEnd::idle;
  OnReopen on_reopen = OnReopen::automatic;
  Chunks chunks = Chunks::automatic;
  Micros burst_gap{500};  // of the tape; and, in real time, between writes that count as one arrival
  // Real time, whatever the rate. At strictness 0, and under warn after the first data mismatch, a gate also
  // opens when the driver has written something and then nothing for `quiet`, or `patience` after the block
  // behind it was due.
  Micros quiet{50'000};
  Micros patience{1'000'000};

  friend bool operator==(const ReplayConfig&, const ReplayConfig&) = default;
};

}  // namespace porttape
