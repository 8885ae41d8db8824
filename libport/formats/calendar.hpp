#pragma once

#include <cstdint>
#include <optional>

namespace porttape {

// Microseconds since 1970 of a date and a time of that day, as if it were UTC. Nothing: there is no such day.
std::optional<std::int64_t> calendar_us(unsigned year, unsigned month, unsigned day, std::int64_t us_of_day);

}  // namespace porttape
