#pragma once

#include <optional>
#include <string>

#include "libport/base/json_object.hpp"
#include "libport/line/line_settings.hpp"
#include "libport/line/line_signal.hpp"

namespace porttape {

// What is known of a line as its driver made it: settings, and what it drives.
struct LineView {
  SeenSettings settings = {};
  std::optional<bool> dtr = {};
  std::optional<bool> rts = {};
  std::optional<bool> brk = {};

  static LineView of(const SeenSettings& settings) { return {.settings = settings}; }
  // Nothing of it where the signal is the device's.
  static LineView of(const LineSignal& signal);
  // As a driver's open makes it.
  static LineView opened() { return {.dtr = true, .rts = true, .brk = false}; }

  // What is known of this, else of `others`.
  [[nodiscard]] LineView over(const LineView& others) const {
    return {settings.over(others.settings), dtr ? dtr : others.dtr, rts ? rts : others.rts,
            brk ? brk : others.brk};
  }

  friend bool operator==(const LineView&, const LineView&) = default;
};

// What is known, for a person: "19200 baud, 8E1"; "dtr off".
std::string to_text(const LineView& line);
// The members of add_settings(), and `dtr`, `rts`, `break`.
void add_line(JsonObject& object, const LineView& line);

}  // namespace porttape
