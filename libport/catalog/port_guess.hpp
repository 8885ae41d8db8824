#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace porttape {

// The two ends of a line.
enum class LineEnd { driver, device };

// The port that a text was probably meant to be, by the text and by what stands at that place in the file
// system: itself where it names a type, `pty:/tmp/laser` for a driver's `/tmp/laser`. Empty where it is a
// tape or looks like nothing known.
std::string meant_port(std::string_view text, LineEnd end);

// Whether a text is a port or was meant to be one.
bool looks_like_port(std::string_view text);

// The end of a message about a text that cannot be read as a port, "is not a port; did you mean
// 'pty:/tmp/laser'?". Nothing where the text names a type, or looks like nothing known.
std::optional<std::string> guess_port(std::string_view text, LineEnd end);

// What was meant by a serial device with a speed behind it as other tools have it, `/dev/ttyUSB0:9600`,
// `/dev/ttyUSB0 9600`, `/dev/ttyUSB0,9600`.
std::optional<std::string> with_speed(std::string_view text);

}  // namespace porttape
