#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "libport/replay/engine.hpp"
#include "tests/support/memory_tape.hpp"

namespace porttape::test {

// An engine on a MemoryTape with a clock that the test moves. Times are microseconds since the rig's start;
// deadlines that come while the clock moves are served at their very moment.
class Rig {
 public:
  struct Delivery {
    std::int64_t us = 0;
    std::string bytes;
    std::vector<std::size_t> block_ends;
    friend bool operator==(const Delivery&, const Delivery&) = default;
    friend void PrintTo(const Delivery& delivery, std::ostream* out) {
      *out << '"' << delivery.bytes << "\" at " << delivery.us << " us, ends";
      for (const std::size_t end : delivery.block_ends) *out << ' ' << end;
    }
  };

  explicit Rig(MemoryTape tape, const ReplayConfig& config = {}, bool stamped_at_arrival = true,
               std::size_t piece = std::numeric_limits<std::size_t>::max(), const Engine::Parts& parts = {})
      : tape_(std::move(tape)),
        schedule(tape_, MemorySource::Select::merged, piece),
        writes(tape_, MemorySource::Select::writes_only, piece),
        engine(
            config,
            {.stamped_at_arrival = stamped_at_arrival,
             .opens = tape_.opens(),
             .hang_ups = tape_.hang_ups(),
             .gaps = tape_.gaps(),
             .totals = TapeTotals{tape_.all(RecordKind::read).size(), tape_.all(RecordKind::write).size()}},
            schedule, writes, parts) {}

  Rig& open() {
    engine.on_open(now());
    return settle();
  }
  Rig& write(std::string_view text) {
    engine.on_write(now(), as_bytes(text));
    return settle();
  }
  Rig& write_bytewise(std::string_view text) {
    for (const char& character : text) write({&character, 1});
    return *this;
  }
  Rig& end_writing() {
    engine.on_writing_ended(now());
    return settle();
  }
  Rig& close() {
    engine.on_close(now());
    return settle();
  }
  Rig& until(std::int64_t us) {
    while (true) {
      const auto deadline = engine.next_deadline();
      if (!deadline || *deadline > at(us)) break;
      clock_ = std::max(clock_, since_start(*deadline));
      advance();
    }
    clock_ = std::max(clock_, Nanos{us * 1000});
    return *this;
  }
  Rig& wait(std::int64_t us) { return until(now_us() + us); }
  // Moves the clock without serving anything on the way.
  Rig& stall(std::int64_t us) { return clock(us).settle(); }
  // Nor then: what comes next is what the engine hears of first.
  Rig& clock(std::int64_t us) {
    clock_ += Nanos{us * 1000};
    return *this;
  }
  // Serves what is due now.
  Rig& settle() {
    advance();
    while (true) {
      const auto deadline = engine.next_deadline();
      if (!deadline || *deadline > now()) return *this;
      advance();
    }
  }
  Rig& blocked(bool on) {
    engine.set_blocked(on);
    return settle();
  }
  void advance() {
    if (++advances_ > 5'000'000) FAIL() << "no progress";
    ReplayActions actions = engine.advance(now(), max_bytes);
    if (!actions.deliver.empty()) {
      deliveries.push_back({now_us(), std::string(as_text(actions.deliver)), actions.block_ends});
      delivered += as_text(actions.deliver);
    }
    mismatches.insert(mismatches.end(), actions.mismatches.begin(), actions.mismatches.end());
    ended = ended || actions.end_sending;
    hung_up = hung_up || actions.hang_up;
    exits = exits || actions.exit;
    if (actions.run_ended) {
      ++runs;
      report = actions.run_ended;
    }
  }
  // What was delivered since the last call.
  std::string read() { return std::exchange(delivered, {}); }
  Verdict finish() {
    engine.finish(now());
    for (bool finished = false; !finished; advance()) finished = engine.finished();
    return verdict();
  }
  Verdict finish_unless_ended() { return report ? report->verdict : finish(); }
  [[nodiscard]] Verdict verdict() const {
    EXPECT_TRUE(report.has_value()) << "no run has ended";
    return report ? report->verdict : Verdict::pass;
  }
  [[nodiscard]] Instant now() const { return Instant{kStart + clock_}; }
  [[nodiscard]] std::int64_t now_us() const { return std::chrono::floor<Micros>(clock_).count(); }
  [[nodiscard]] std::optional<std::int64_t> deadline_us() const {
    const auto deadline = engine.next_deadline();
    if (!deadline) return std::nullopt;
    return std::chrono::floor<Micros>(since_start(*deadline)).count();
  }

 private:
  static constexpr Nanos kStart{123'456'789'000};
  static Instant at(std::int64_t us) { return Instant{kStart + Nanos{us * 1000}}; }
  static Nanos since_start(Instant instant) { return instant.time_since_epoch() - kStart; }

  MemoryTape tape_;
  Nanos clock_{0};
  std::uint64_t advances_ = 0;

 public:
  MemorySource schedule;
  MemorySource writes;
  Engine engine;
  std::size_t max_bytes = 65536;
  std::vector<Delivery> deliveries;
  std::string delivered;
  std::vector<Mismatch> mismatches;
  bool ended = false;  // the device's sending
  bool hung_up = false;
  bool exits = false;
  int runs = 0;
  std::optional<RunReport> report;
};

}  // namespace porttape::test
