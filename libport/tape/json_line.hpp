#pragma once

#include <string_view>

#include <boost/json/value.hpp>

namespace porttape {

// The value of an events file's line, whatever its bytes outside of UTF-8; null where it is no JSON object.
boost::json::value parse_json_line(std::string_view line);

// Whether a text begins with a whole JSON value and has more than white space behind it, or than the zeros
// that a file system leaves where the machine went down.
bool goes_on_behind_object(std::string_view text);

}  // namespace porttape
