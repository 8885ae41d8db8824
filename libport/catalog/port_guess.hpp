#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace porttape {

// The two ends of a line.
enum class LineEnd { driver, device };

// What a text that names no type of port was probably meant to be, by the text and by what stands at that
// place in the file system: the end of a message, "is not a port; did you mean 'pty:/tmp/laser'?". Nothing
// where the text names a type, or looks like nothing known.
std::optional<std::string> guess_port(std::string_view text, LineEnd end);

// Whether a text is a port or was probably meant to be one.
bool looks_like_port(std::string_view text);

}  // namespace porttape
