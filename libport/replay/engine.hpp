#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"
#include "libport/replay/replay_config.hpp"
#include "libport/replay/report.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// What the engine wants done, in this order. Values only; the engine performs nothing itself.
struct ReplayActions {
  Bytes deliver;  // hand to the driver, in one write unless the line keeps datagrams
  std::vector<std::size_t>
      block_ends;  // where each (piece of an) arrival ends in `deliver`; the last is its size
  std::vector<Mismatch> mismatches;    // new ones, to tell
  bool hang_up = false;                // make the driver see the line break (on-mismatch fail, at-end hangup)
  std::optional<RunReport> run_ended;  // a run is over; after it the next on_open begins another
  bool exit = false;  // at-end exit: the program should end, once the driver has read what was delivered

  [[nodiscard]] bool empty() const {
    return deliver.empty() && mismatches.empty() && !hang_up && !run_ended && !exit;
  }
};

// The device a tape plays. Pure: no I/O of its own (the tape comes through the two sources), reads no clock,
// starts no thread, logs nothing; time is an argument and never goes back.
//
// Drive it: on_open when the driver opens, on_write for what it writes, on_close when it closes, finish at
// the end of the program; after each of these, and when next_deadline() has come, call advance(now) until it
// gives nothing that is due. `schedule` is the whole tape in merged order, `writes` the w file alone; both
// must outlive the engine and be its own.
class Engine {
 public:
  struct TapeFacts {
    bool stamped_at_arrival = false;  // has an events file: chunks=auto means `recorded`, else `burst`
    std::uint64_t opens = 0;  // `open` events on the whole tape: a close with one ahead does not end the run
  };

  Engine(const ReplayConfig& config, const TapeFacts& facts, RecordSource& schedule, RecordSource& writes);
  ~Engine();
  Engine(const Engine&) = delete;
  Engine& operator=(const Engine&) = delete;

  void on_open(Instant now);
  void on_write(Instant now, ByteView data);
  void on_close(Instant now);

  // When advance() should be called next; nothing while only the driver can move things on.
  [[nodiscard]] std::optional<Instant> next_deadline() const;

  // Does everything due at `now`, at most `max_bytes` of delivery a call (the rest stays due: next_deadline()
  // <= now).
  [[nodiscard]] ReplayActions advance(Instant now, std::size_t max_bytes = 65536);

  // The program or the command ends: ends the run (if one has begun) and gives its report.
  [[nodiscard]] std::optional<RunReport> finish(Instant now);

  // The line could not take bytes at `now` / can again: lateness is not measured in between, deliveries wait.
  void set_blocked(bool blocked);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace porttape
