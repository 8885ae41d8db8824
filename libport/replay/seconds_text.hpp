#pragma once

#include <cstdint>
#include <string>

#include "libport/base/time.hpp"

namespace porttape {

// "1.234567 s"
std::string seconds_text(std::int64_t us);

// For a message or a JSON number.
constexpr double seconds_of(TapeTime time) { return static_cast<double>(to_us(time)) / 1e6; }

}  // namespace porttape
