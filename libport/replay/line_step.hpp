#pragma once

#include <cstdint>
#include <optional>

#include "libport/line/line_settings.hpp"
#include "libport/tape/event.hpp"

namespace porttape {

// What a driver does with its line beside writing to it, where the tape plays the driver.
struct LineStep {
  enum class Kind : std::uint8_t { open, close, settings, flush, signal };
  Kind kind = Kind::open;
  SeenSettings settings{};            // that it makes its line; what it leaves alone is absent
  std::optional<FlushQueue> queue{};  // that it drops; nothing: not known
  LineSignal signal{};                // that it changes

  friend bool operator==(const LineStep&, const LineStep&) = default;
};

}  // namespace porttape
