#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "libport/tape/block.hpp"
#include "libport/tape/event.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/tape/tape_reader.hpp"

namespace porttape {

// What an r or w file holds, up to its damage if there is any.
struct FileSummary {
  std::string path;  // also where it does not exist
  bool exists = false;
  std::uint64_t file_bytes = 0;
  std::uint64_t blocks = 0;
  std::uint64_t bytes = 0;  // payload
  std::uint32_t largest_block = 0;
  std::optional<std::uint64_t> xxh3;  // of the payload; nothing where the tape tells none to compare it with
  std::optional<std::uint64_t> xxh3_all;  // of all blocks, in the same way
  std::optional<TapeTime> first;
  std::optional<TapeTime> last;
  std::uint64_t torn_bytes = 0;
  std::optional<std::string> torn_tail;  // a note for a person
  std::optional<Error> damage;           // or that it could not be read on (Errc::io)

  [[nodiscard]] PayloadTotals totals() const { return {blocks, bytes, xxh3, xxh3_all}; }
};

struct GapSummary {
  TapeTime from{};
  TapeTime at{};
  std::uint64_t bytes = 0;  // 0: not known, or events only
  StrangerText why;
};

// From an open to the close behind it; bytes that nobody had the line open for belong to none.
struct SessionSummary {
  std::optional<TapeTime> opened;  // nothing: a tape without opens, which is one session
  std::optional<TapeTime> closed;  // nothing: the next open, or the tape's end, came without a close
  Micros duration{};
  std::uint64_t read_bytes = 0;
  std::uint64_t write_bytes = 0;
};

struct MarkSummary {
  TapeTime at{};
  StrangerText text;
};

struct SettingsSummary {
  TapeTime at{};
  event::Settings what;
};

struct SignalSummary {
  TapeTime at{};
  TapedSignal what;
};

struct FaultSummary {
  TapeTime at{};
  event::Fault what;
};

struct EventsSummary {
  std::string path;
  bool exists = false;
  std::optional<TapeHeader> header;
  std::map<StrangerText, std::uint64_t>
      kinds;                       // how many events of each; of unknown kinds at most 64 different ones
  std::uint64_t gap_bytes = 0;     // that the gap events say are missing
  std::vector<GapSummary> gaps;    // the first 64
  std::vector<MarkSummary> marks;  // the first 64
  std::vector<SettingsSummary> settings;              // the first 64
  std::vector<SignalSummary> signals;                 // of modem lines and breaks, the first 64
  std::vector<FaultSummary> faults;                   // the first 64, plans among them
  std::map<StrangerText, std::uint64_t> fault_kinds;  // how many were made of each; at most 64 kinds
  bool ended = false;                                 // the last event is `end`
  std::optional<PayloadTotals> end_read;              // what it tells of the r and w files, both or none
  std::optional<PayloadTotals> end_write;
  bool covers_lines = false;  // it vouches for the lines before it
  std::optional<TapeTime> last;
  std::optional<std::string> torn_tail;
  std::optional<Error> damage;

  template <class Kind>
  [[nodiscard]] std::uint64_t count() const {
    return count(Kind::kName);
  }

 private:
  [[nodiscard]] std::uint64_t count(std::string_view kind) const;
};

// Microseconds from the last write block of an exchange to the first read block behind it.
struct LatencySummary {
  std::int64_t min_us = 0;
  std::int64_t median_us = 0;
  std::int64_t p99_us = 0;
  std::int64_t max_us = 0;
};

// What one pass over a tape finds: all that `porttape info` prints and `porttape verify` judges.
struct TapeSummary {
  std::string name;
  bool being_written = false;
  Layout layout = Layout::big_endian;
  FileSummary read;
  FileSummary write;
  EventsSummary events;
  std::uint64_t exchanges = 0;  // a run of write blocks and the read blocks up to the next write
  std::uint64_t answered = 0;   // exchanges with a read block, with no open or close in between
  std::optional<LatencySummary> latency;
  std::uint64_t session_count = 0;       // as far as the tape is undamaged
  std::vector<SessionSummary> sessions;  // the first 1000

  // From the tape's zero to its last block or event.
  [[nodiscard]] Micros duration() const;
  [[nodiscard]] std::vector<Error> damages() const;
  [[nodiscard]] std::vector<std::string> torn_tails() const;
};

// Reads the whole tape once, in constant memory; what is damaged ends that file and not the others. Errors:
// only what keeps it from being read at all (Errc::usage, Errc::not_a_tape, Errc::io; Errc::damaged_tape: its
// r and w files are in no layout).
Result<TapeSummary> summarize(const TapePaths& paths);
Result<TapeSummary> summarize(std::string name, TapeSources sources);

}  // namespace porttape
