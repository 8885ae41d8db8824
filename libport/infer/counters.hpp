#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "libport/base/bytes.hpp"

namespace porttape {

// A number in frames that grows by the same step from each to the next.
struct CounterPlace {
  std::size_t offset = 0;  // from the frame's begin
  std::size_t size = 1;    // bytes; it wraps there
  bool little_endian = false;
  std::int64_t step = 1;
  friend bool operator==(const CounterPlace&, const CounterPlace&) = default;
};

// The frames of one tape, in order.
using FrameRun = std::vector<ByteView>;

// The counters that all runs have, each begun anywhere: those of at least five frames, widest first, none
// over another. A number whose first byte never changes is taken for a narrower one.
std::vector<CounterPlace> find_counters(std::span<const FrameRun> runs);

// The same for the texts that one field has, run by run: digits of `base`, 10 or 16.
struct TextCounter {
  int base = 10;
  std::int64_t step = 1;
  friend bool operator==(const TextCounter&, const TextCounter&) = default;
};
std::optional<TextCounter> find_text_counter(std::span<const std::vector<std::string_view>> runs);

// A number of 1 to 8 bytes.
std::uint64_t number_at(ByteView bytes, bool little_endian);

}  // namespace porttape
