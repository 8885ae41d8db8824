#pragma once

#include <cstdint>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/replay/roles.hpp"

namespace porttape {

enum class Timing : std::uint8_t { reactive, recorded, none };
enum class OnMismatch : std::uint8_t { fail, warn, resync };
enum class Match : std::uint8_t { sequence, lookup };
enum class AtEnd : std::uint8_t { idle, hangup, exit };
enum class OnReopen : std::uint8_t { automatic, rewind, continue_ };
enum class Chunks : std::uint8_t { automatic, recorded, burst, bytes, random };

// The replay options of contract section 4, with the defaults of the verb `replay`.
struct ReplayConfig {
  Writer writer = Writer::driver;  // whose bytes are judged; what is said here of the driver is said of it
  int strictness = 1;              // 0 writes not checked, 1 data, 2 data and timing
  Micros jitter{100'000};          // strictness 2: margin early and late, in real time
  bool late_allowed = false;       // strictness 2: only early writes are timing mismatches
  Timing timing = Timing::reactive;
  double rate = 1.0;  // > 0; time runs this many times as fast
  OnMismatch on_mismatch = OnMismatch::warn;
  Match match = Match::sequence;  // lookup: strictness below 2, and timing not recorded
  AtEnd at_end = AtEnd::idle;
  OnReopen on_reopen = OnReopen::automatic;
  Chunks chunks = Chunks::automatic;  // bytes and random cut what `automatic` joins
  std::uint32_t chunk_seed = 0;       // of random
  // The part that is played, by the tape's time: from the start on (what was recorded there is the first), up
  // to the end, which the sources of the tape are at (see PartOfTape). `preroll`: the handshake before the
  // start comes first, without waiting.
  TapeTime start{};
  std::optional<TapeTime> end = {};
  bool preroll = false;
  std::uint64_t loops = 1;             // so often in all; 0: for ever
  std::optional<Micros> max_gap = {};  // of the tape; what idle gaps longer than that are cut to
  bool check_settings = false;         // recorded settings that the driver never makes are a mismatch
  bool must_read = false;              // what was recorded as read and was not makes the run incomplete
  Micros burst_gap{500};  // of the tape; and, in real time, between writes that count as one arrival
  // Real time, whatever the rate. At strictness 0, and under warn after the first data mismatch, a gate also
  // opens when the driver has written something and then nothing for `quiet`, or `patience` after the block
  // behind it was due.
  Micros quiet{50'000};
  Micros patience{1'000'000};

  friend bool operator==(const ReplayConfig&, const ReplayConfig&) = default;
};

}  // namespace porttape
