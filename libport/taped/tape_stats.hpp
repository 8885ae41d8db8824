#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "libport/rules/rule_set.hpp"
#include "libport/tape/part_writer.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// Times from the last write of an exchange to the first read behind it, or from one message to the next.
struct SpanStats {
  std::uint64_t count = 0;
  std::int64_t min_us = 0;
  std::int64_t median_us = 0;
  std::int64_t p90_us = 0;
  std::int64_t p99_us = 0;
  std::int64_t max_us = 0;
};

// An exchange as `porttape info` counts them: a run of writes, and what was read up to the next one.
struct TapeExchange {
  std::uint64_t number = 0;  // from 1
  TapeTime at{};             // of its first write
  TapeTime until{};          // of its last block
  std::optional<Micros> answer;
  std::uint64_t written = 0;  // bytes
  std::uint64_t read = 0;
  std::string command;  // frame_command() of its last frame; of none: of how it begins
};

// Frames, or where no format is given exchanges, that are about the same.
struct CommandStats {
  std::string command;
  std::uint64_t count = 0;
  std::uint64_t bytes = 0;
  std::uint64_t unanswered = 0;     // writes: nothing was read before the next frame, or exchange, or the end
  SpanStats spans;                  // writes: the answers to them; reads: from one to the next
  std::optional<TapeTime> longest;  // where the longest span begins
};

struct DirectionStats {
  std::uint64_t blocks = 0;
  std::uint64_t bytes = 0;
  std::uint64_t busiest_bytes = 0;     // in one second of the tape
  TapeTime busiest{};                  // that second
  std::uint64_t stray = 0;             // bytes of no frame, where formats are given
  std::vector<CommandStats> commands;  // the most frequent first; kMaxCommands, the others as one
};

struct Silence {
  TapeTime from{};
  Micros length{};
};

struct TapeStats {
  Micros duration{};
  std::uint64_t exchanges = 0;
  std::uint64_t answered = 0;
  SpanStats answers;
  DirectionStats read;
  DirectionStats write;
  std::uint64_t silences = 0;             // while the line was open, at least as long as asked
  Micros silent{};                        // all of them
  std::vector<Silence> longest_silences;  // the longest first
  std::vector<TapeExchange> slowest;      // the slowest first
};

inline constexpr std::size_t kMaxCommands = 256;
inline constexpr std::string_view kOtherCommands = "(others)";

struct TapeStatsOptions {
  std::vector<FrameFormat> formats;  // of both directions; empty: exchanges are told apart by their writes
  Micros silence = std::chrono::seconds(1);
  std::size_t most = 10;                                 // of the slowest and of the silences
  std::function<void(const TapeExchange&)> on_exchange;  // each, when it has ended
  TapeProgress progress;
};

// Reads the whole tape once, in constant memory. Errors as of the source.
Result<TapeStats> count_stats(RecordSource& tape, const TapeStatsOptions& options);

}  // namespace porttape
