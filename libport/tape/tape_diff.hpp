#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/tape/turn_reader.hpp"

namespace porttape {

struct TapeDiffOptions {
  std::optional<Micros> margin = std::chrono::milliseconds(100);  // none: times do not matter
  bool events = true;     // whether they are compared, where both tapes have some
  TapeProgress progress;  // of both tapes together
};

// One difference of two tapes, by the numbers of their turns as a TurnReader gives them, from 0.
struct TapeDifference {
  enum class Kind : std::uint8_t { added, missing, changed, moved, slower, faster };
  enum class Time : std::uint8_t { answer, wait };  // of slower and faster

  static constexpr std::uint32_t kNone = 0xffffffff;
  Kind kind = Kind::changed;
  Time time = Time::answer;
  std::uint32_t one = kNone;    // of the first tape; none: added
  std::uint32_t other = kNone;  // of the second; none: missing
  bool crosses = false;         // `one` is not in the order of the differences
};
inline constexpr std::size_t kTapeDifferenceKinds = 6;
std::string_view to_string(TapeDifference::Kind kind);

// What one of the tapes holds.
struct ComparedTape {
  std::uint64_t exchanges = 0;  // as porttape info counts them
  std::uint64_t turns = 0;      // those that are no events
  std::uint64_t events = 0;     // as far as they are compared
  bool has_events = false;      // there is an events file
  std::optional<std::string> torn_tail;
};

struct TapeDiff {
  std::vector<TapeDifference> differences;  // in the order of the tapes
  std::array<std::uint64_t, kTapeDifferenceKinds> counts{};
  ComparedTape one;
  ComparedTape other;
  bool events = false;     // whether they are compared
  std::uint64_t same = 0;  // turns with the same bytes in the same place, events left out

  [[nodiscard]] bool equal() const { return differences.empty(); }
  [[nodiscard]] std::uint64_t count(TapeDifference::Kind kind) const {
    return counts.at(static_cast<std::size_t>(kind));
  }
};

// Compares what was said, turn by turn: the same bytes in another cut or at another time are the same. About
// 100 bytes of memory a turn; time grows with the tapes' sizes, however different they are. Errors as of
// TapeReader.
Result<TapeDiff> diff_tapes(const TapePaths& one, const TapePaths& other, const TapeDiffOptions& options);

}  // namespace porttape
