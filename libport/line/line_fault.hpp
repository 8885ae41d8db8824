#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "libport/base/stranger_text.hpp"

namespace porttape {

// The two streams of a line, as a tape's files have them: `r` goes to the driver, `w` to the device.
enum class LineDir : std::uint8_t { r, w };

inline std::string_view to_string(LineDir dir) { return dir == LineDir::r ? "r" : "w"; }

// What was done to a line on purpose (libport/faults/FAULTS.md).
struct LineFault {
  // The kind of fault (drop, corrupt, …), or
  static constexpr std::string_view kPlan = "plan";  // what is to come: the whole plan and its seed
  static constexpr std::string_view kMore = "more";  // `count` further ones, not told singly
  StrangerText kind;
  StrangerText spec = {};                    // a plan of its own, which makes this fault again in its place
  std::optional<LineDir> dir = {};           // none: neither is meant
  std::optional<std::uint64_t> offset = {};  // of the first byte concerned, in its stream as it came
  std::uint64_t count = 0;                   // of kMore
  std::optional<std::uint64_t> seed = {};    // of kPlan

  friend bool operator==(const LineFault&, const LineFault&) = default;
};

}  // namespace porttape
