#pragma once

#include <string_view>

#include "libport/formats/dialect_format.hpp"

namespace porttape {

// The TOML file of a dialect that comes with porttape.
std::string_view shipped_dialect(ShippedDialect which);

}  // namespace porttape
