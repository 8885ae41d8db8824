#pragma once

#include <cstdint>
#include <string>

namespace porttape {

// "1.234567 s"
std::string seconds_text(std::int64_t us);

}  // namespace porttape
