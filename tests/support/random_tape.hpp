#pragma once

#include <cstdint>
#include <string>

#include "tests/support/memory_tape.hpp"

namespace porttape::test {

// What kind of tape random_tape() makes.
struct RandomTapeShape {
  bool sessions = false;     // several opens and closes
  bool hang_ups = false;     // at the end of some sessions
  bool half_closes = false;  // of either side
  bool gaps = false;
  bool signals = false;      // of either side
  bool empty_blocks = true;  // zero-length reads and writes among the others
  std::uint32_t max_records = 60;
};

// A tape made by `choose(n)`, which gives a number in [0, n): a random generator in tests, the input in fuzz
// targets. Times never go back; gaps range from none through bursts to 30 ms; bytes come from a small
// alphabet, so that repeats and near misses are common.
template <class Choose>
MemoryTape random_tape(Choose&& choose, const RandomTapeShape& shape = {}) {
  MemoryTape tape;
  std::int64_t now = 0;
  bool line_open = true;
  if (shape.sessions) tape.open(0);
  const auto bytes = [&] {
    std::string text;
    const std::uint32_t size = choose(shape.empty_blocks ? 8U : 7U) + (shape.empty_blocks ? 0U : 1U);
    for (std::uint32_t i = 0; i < size; ++i) text += static_cast<char>('a' + choose(3));
    return text;
  };
  const std::uint32_t records = choose(shape.max_records);
  for (std::uint32_t i = 0; i < records; ++i) {
    const std::uint32_t pace = choose(4);
    now += pace == 0 ? 0 : pace == 1 ? choose(600) : choose(30'000);
    const std::uint32_t kind = choose(12);
    if (shape.sessions && kind == 0) {
      // After the last write, as every event at the same time is read before it.
      if (shape.hang_ups && line_open && choose(2) == 0) tape.hang_up(++now);
      line_open ? tape.close(now) : tape.open(now);
      line_open = !line_open;
    } else if (shape.gaps && kind == 2) {
      const std::int64_t from = now;
      now += 1 + choose(30'000);
      tape.gap(now, choose(20), from);
    } else if (shape.half_closes && line_open && kind == 3) {
      tape.half_close(++now, choose(2) == 0 ? Side::driver : Side::device);
    } else if (kind == 1 && !line_open) {
      tape.event(now, event::Unknown{"settings-to-come"});
    } else if (kind == 1 && shape.signals && choose(3) > 0) {
      const Side by = choose(2) == 0 ? Side::device : Side::driver;
      const auto first = by == Side::driver ? LineSignal::Name::dtr : LineSignal::Name::cts;
      const auto name = static_cast<LineSignal::Name>(static_cast<std::uint32_t>(first) + choose(2));
      tape.event(now, signal_event({by, {name, choose(2) == 1}}));
    } else if (kind == 1) {
      const Side by = choose(4) == 0 ? Side::device : Side::driver;
      tape.event(now, event::Settings{by, {.baud = 300 * (1 + choose(3)), .stop_bits = 1}, {}});
    } else if (line_open && kind < 6) {
      tape.write(now, bytes());
    } else if (line_open) {
      tape.read(now, bytes());
    }
  }
  return tape;
}

}  // namespace porttape::test
