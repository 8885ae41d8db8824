#pragma once

#include <cstdint>
#include <optional>

#include "libport/line/line_event.hpp"

namespace porttape {

// What a driver does with its line beside writing to it, where the tape plays the driver.
struct LineStep {
  enum class Kind : std::uint8_t { open, close, event };
  Kind kind = Kind::open;
  std::optional<LineEvent> event{};  // that it makes happen; what it leaves alone of its settings is absent
};

}  // namespace porttape
