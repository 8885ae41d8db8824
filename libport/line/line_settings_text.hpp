#pragma once

#include <array>
#include <string>
#include <string_view>

#include "libport/base/json_object.hpp"
#include "libport/line/line_settings.hpp"

namespace porttape {

// As options and tapes have them; the place is the value.
inline constexpr auto kParityWords =
    std::to_array<std::string_view>({"none", "even", "odd", "mark", "space"});
std::string_view to_string(Parity parity);

// What is known of them, for a person: "115200 baud, 8N1, RTS/CTS"; of a pty, which shows neither parity nor
// data bits, "9600 baud, 1 stop bit". A rate of 0 is "hung up (B0)".
std::string to_text(const SeenSettings& settings);

// A member for each that is known, as tapes and reports have them: `baud`, `databits`, `parity`, `stopbits`,
// `hwflowctrl`, `swflowctrl`.
void add_settings(JsonObject& object, const SeenSettings& settings);

}  // namespace porttape
