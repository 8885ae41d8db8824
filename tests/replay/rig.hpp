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
#include "libport/replay/swapped_tape.hpp"
#include "tests/support/memory_tape.hpp"

namespace porttape::test {

// An engine on a MemoryTape with a clock that the test moves; where the config judges the device, the tape
// plays the driver, and it is the device that opens, writes and closes here. Times are microseconds since the
// rig's start; deadlines that come while the clock moves are served at their very moment.
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
        drives_(drives(config)),
        schedule(tape_, MemorySource::Select::merged, piece),
        writes(tape_, drives(config) ? MemorySource::Select::merged : MemorySource::Select::writes_only,
               piece),
        index(tape_, MemorySource::Select::merged, piece),
        answers(tape_, piece),
        engine(config, facts(config, stamped_at_arrival),
               drives(config) ? static_cast<RecordSource&>(swapped) : schedule,
               drives(config) ? static_cast<RecordSource&>(swapped_writes) : writes, with_index(parts)) {}

  Rig& open() {
    line_gone_ = false;
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
  Rig& line_ended() {
    engine.on_line_ended(now());
    return settle();
  }
  Rig& tell(const LineEvent& event) {
    engine.on_event(now(), event);
    return settle();
  }
  Rig& set(const SeenSettings& settings) { return tell(line::Settings{settings}); }
  Rig& signal(LineSignal::Name name, bool on) { return tell(LineSignal{name, on}); }
  Rig& flush() {
    engine.on_event(now(), line::Flush{});
    return settle();
  }
  Rig& stand(bool on = true) {
    engine.stand(now(), on);
    return settle();
  }
  Rig& step(std::uint64_t exchanges = 1) {
    engine.step(now(), exchanges);
    return settle();
  }
  Rig& seek(std::int64_t us) {
    engine.seek(now(), tape_time_us(us));
    return settle();
  }
  Rig& rate(double rate) {
    engine.set_rate(now(), rate);
    return settle();
  }
  [[nodiscard]] std::int64_t position() {
    return to_us(engine.playing(now()).position.value_or(tape_time_us(-1)));
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
    const bool tells = !actions.deliver.empty() || !actions.events.empty() || actions.end_sending;
    EXPECT_FALSE(line_gone_ && tells) << "something is told on a line that was hung up, at " << now_us();
    line_gone_ = line_gone_ || (actions.hang_up && !drives_);
    for (const ReplayActions::Told& each : actions.events) {
      const auto& signal = std::get<LineSignal>(each.event);
      signals.push_back(std::string(name_of(signal.name)) + (signal.on ? " on" : " off") + " behind " +
                        std::to_string(delivered.size() + each.behind) + " at " + std::to_string(now_us()));
    }
    if (!actions.deliver.empty()) {
      deliveries.push_back({now_us(), std::string(as_text(actions.deliver)), actions.block_ends});
      delivered += as_text(actions.deliver);
    }
    mismatches.insert(mismatches.end(), actions.mismatches.begin(), actions.mismatches.end());
    if (actions.line_step) line_steps.emplace_back(now_us(), *actions.line_step);
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
  Engine::Parts with_index(Engine::Parts parts) {
    parts.index = &index;
    parts.answers = &answers;
    return parts;
  }
  static Nanos since_start(Instant instant) { return instant.time_since_epoch() - kStart; }
  static bool drives(const ReplayConfig& config) { return config.writer == Writer::device; }
  [[nodiscard]] Engine::TapeFacts facts(const ReplayConfig& config, bool stamped_at_arrival) const {
    TapeTotals totals{tape_.all(RecordKind::read).size(), tape_.all(RecordKind::write).size()};
    if (drives(config)) std::swap(totals.reads, totals.writes);
    return {.stamped_at_arrival = stamped_at_arrival,
            .opens = tape_.opens(),
            .hang_ups = tape_.hang_ups(),
            .gaps = tape_.gaps(),
            .preroll_from = config.preroll ? tape_.open_before(to_us(config.start)) : std::nullopt,
            .totals = totals};
  }

  MemoryTape tape_;
  Nanos clock_{0};
  std::uint64_t advances_ = 0;
  bool drives_;
  bool line_gone_ = false;  // hung up, and not opened since

 public:
  MemorySource schedule;
  MemorySource writes;
  SwappedTape swapped{schedule};
  SwappedTape swapped_writes{writes, SwappedTape::Select::writes_only};
  MemorySource index;
  MemoryAnswers answers;
  Engine engine;
  std::size_t max_bytes = 65536;
  std::vector<std::string> signals;  // of the device
  std::vector<Delivery> deliveries;
  std::string delivered;
  std::vector<Mismatch> mismatches;
  std::vector<std::pair<std::int64_t, LineStep>> line_steps;  // and when
  bool ended = false;                                         // the device's sending
  bool hung_up = false;
  bool exits = false;
  int runs = 0;
  std::optional<RunReport> report;
};

constexpr Engine::Parts kSocket{.half_closes = true};

inline ReplayConfig failing(int strictness = 1) {
  ReplayConfig config;
  config.strictness = strictness;
  config.on_mismatch = OnMismatch::fail;
  return config;
}

inline ReplayConfig recorded(int strictness = 1) {
  ReplayConfig config;
  config.timing = Timing::recorded;
  config.strictness = strictness;
  return config;
}

}  // namespace porttape::test
