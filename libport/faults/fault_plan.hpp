#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "libport/line/line_fault.hpp"

namespace porttape {

// What is to be done to a line, and when: one part of a plan. FAULTS.md has the text form and what each
// means.
struct Fault {
  enum class Kind : std::uint8_t { drop, corrupt, duplicate, delay, stall, truncate, hangup, replug };
  enum class When : std::uint8_t { chance, byte, frame, time };
  enum class Unit : std::uint8_t { automatic, byte, frame };

  Kind kind = Kind::drop;
  When when = When::chance;
  double chance = 0;
  std::uint64_t position = 0;       // of When::byte from 0 on, of When::frame from 1 on
  Nanos at{};                       // of When::time, after the line first came up
  std::optional<LineDir> dir = {};  // none: both
  Unit unit = Unit::automatic;      // of `chance` and `burst`
  Bytes frame_end = {'\n'};
  std::uint64_t frame_size = 0;            // 0: frames end by frame_end
  std::uint64_t burst = 1;                 // units in a row
  std::uint64_t times = 0;                 // at most so often; 0: no limit
  Nanos length{};                          // of delay, stall and replug
  std::optional<std::uint64_t> keep = {};  // bytes at the beginning of a truncated frame; none: drawn
  Bytes change = {};                       // what bytes are XORed with, over and over; empty: drawn

  friend bool operator==(const Fault&, const Fault&) = default;
};

std::string_view to_string(Fault::Kind kind);
// `drop:p=0.01:dir=r`, without a comma: it can stand in a port's spelling.
std::string to_text(const Fault& fault);

struct FaultPlan {
  static constexpr std::size_t kMostFaults = 10'000;
  std::vector<Fault> faults;

  [[nodiscard]] std::string text() const;  // the faults, a `;` between two
  friend bool operator==(const FaultPlan&, const FaultPlan&) = default;
};

// Reads `KIND[:key=value…][;…]`; lines count as `;`, and # begins a comment. What says no direction has `dir`
// (none: both). Errc::usage names the line (of several), kind and key, the value and what is accepted.
Result<FaultPlan> parse_fault_plan(std::string_view text, std::optional<LineDir> dir);

// The same from a text or a file: what begins with a kind is a plan, else it is a regular file of up to 1
// MiB.
Result<FaultPlan> load_fault_plan(const std::string& text_or_file, std::optional<LineDir> dir);

}  // namespace porttape
