#pragma once

#include <optional>
#include <string_view>

#include "libport/base/bytes.hpp"

namespace porttape {

// A byte as Logic writes it: 0x41, 'A' (0x41), 0b  0100 0001, 65 (where `decimal`), A, \n, COMMA, ' '.
std::optional<Byte> saleae_value(std::string_view text, bool decimal);

}  // namespace porttape
