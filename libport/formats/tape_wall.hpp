#pragma once

#include <cstdint>
#include <optional>

#include "libport/tape/tape_header.hpp"

namespace porttape {

// The tape's zero in microseconds since 1970; 0 where nobody knows it.
std::uint64_t wall_us_of_zero(const std::optional<TapeHeader>& header);

}  // namespace porttape
