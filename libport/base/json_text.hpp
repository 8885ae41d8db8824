#pragma once

#include <string>
#include <string_view>

namespace porttape {

// The text with every byte that is not part of well-formed UTF-8 replaced by U+FFFD.
std::string to_utf8(std::string_view text);

// The text as a JSON string, quotes included: always valid JSON in valid UTF-8, whatever the bytes.
std::string json_quote(std::string_view text);

// A line of JSON from elsewhere, with what a terminal would obey escaped in its strings; still the same JSON.
std::string json_for_terminal(std::string_view json);

}  // namespace porttape
