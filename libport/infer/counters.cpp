#include "libport/infer/counters.hpp"

#include <algorithm>
#include <array>
#include <charconv>

namespace porttape {
namespace {

constexpr std::size_t kFewestSteps = 4;

// The step that all runs of numbers below 2^bits have; nothing where they have none, or too little shows.
std::optional<std::int64_t> common_step(std::span<const std::vector<std::uint64_t>> runs, std::size_t bits) {
  const std::uint64_t mask = bits >= 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << bits) - 1;
  std::optional<std::uint64_t> step;
  std::size_t seen = 0;
  for (const auto& run : runs) {
    for (std::size_t i = 1; i < run.size(); ++i, ++seen) {
      const std::uint64_t grown = (run[i] - run[i - 1]) & mask;
      if (grown == 0 || (step && *step != grown)) return std::nullopt;
      step = grown;
    }
  }
  if (seen < kFewestSteps) return std::nullopt;
  const bool down = *step > mask / 2;
  return down ? -static_cast<std::int64_t>((mask - *step) + 1) : static_cast<std::int64_t>(*step);
}

bool varies(std::span<const FrameRun> runs, std::size_t offset) {
  const auto first = std::ranges::find_if(runs, [](const FrameRun& run) { return !run.empty(); });
  if (first == runs.end()) return false;
  const Byte byte = first->front()[offset];
  return std::ranges::any_of(runs, [&](const FrameRun& run) {
    return std::ranges::any_of(run, [&](ByteView frame) { return frame[offset] != byte; });
  });
}

std::optional<std::int64_t> step_at(std::span<const FrameRun> runs, const CounterPlace& place) {
  std::vector<std::vector<std::uint64_t>> numbers;
  for (const FrameRun& run : runs) {
    auto& row = numbers.emplace_back();
    for (const ByteView frame : run)
      row.push_back(number_at(frame.subspan(place.offset, place.size), place.little_endian));
  }
  return common_step(numbers, 8 * place.size);
}

bool overlap(const CounterPlace& a, const CounterPlace& b) {
  return a.offset < b.offset + b.size && b.offset < a.offset + a.size;
}

}  // namespace

std::uint64_t number_at(ByteView bytes, bool little_endian) {
  std::uint64_t number = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i)
    number = (number << 8U) | bytes[little_endian ? bytes.size() - 1 - i : i];
  return number;
}

std::vector<CounterPlace> find_counters(std::span<const FrameRun> runs) {
  std::size_t shortest = std::size_t{64};  // a counter stands in a frame's head
  for (const FrameRun& run : runs)
    for (const ByteView frame : run) shortest = std::min(shortest, frame.size());
  std::vector<CounterPlace> found;
  for (const std::size_t size : std::array<std::size_t, 4>{8, 4, 2, 1}) {
    for (std::size_t offset = 0; offset + size <= shortest; ++offset) {
      for (const bool little : {false, true}) {
        if (size == 1 && little) continue;
        CounterPlace counter{offset, size, little, 1};
        const bool taken =
            std::ranges::any_of(found, [&](const CounterPlace& other) { return overlap(counter, other); });
        if (taken || !varies(runs, little ? offset + size - 1 : offset)) continue;
        const auto step = step_at(runs, counter);
        if (!step || (size > 1 && *step % 256 == 0)) continue;  // its last byte stands still: a shorter one
        counter.step = *step;
        found.push_back(counter);
      }
    }
  }
  return found;
}

std::optional<TextCounter> find_text_counter(std::span<const std::vector<std::string_view>> runs) {
  for (const int base : {10, 16}) {
    std::vector<std::vector<std::uint64_t>> numbers;
    bool all = true;
    for (const auto& run : runs) {
      auto& row = numbers.emplace_back();
      for (const std::string_view text : run) {
        std::uint64_t number = 0;
        const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number, base);
        all = all && error == std::errc{} && end == text.data() + text.size();
        row.push_back(number);
      }
    }
    if (!all) continue;
    if (const auto step = common_step(numbers, 64)) return TextCounter{base, *step};
  }
  return std::nullopt;
}

}  // namespace porttape
