#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace porttape {

// "12.000345": microseconds as seconds, exact.
std::string seconds_number(std::int64_t us);

// "850 us", "98.8 ms", "12.3 s".
std::string span_text(std::int64_t us);

// "3.5 kB/s"; "-" where no time passed.
std::string rate_text(std::uint64_t bytes, std::int64_t us);

// "1 byte", "2 bytes".
std::string counted(std::uint64_t count, std::string_view noun);

}  // namespace porttape
