#pragma once

#include <string_view>

#include <boost/json/value.hpp>

namespace porttape {

// The value of an events file's line, whatever its bytes outside of UTF-8; null where it is no JSON object.
boost::json::value parse_json_line(std::string_view line);

}  // namespace porttape
