#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "libport/base/bytes.hpp"

namespace porttape {

// RFC 4648, with padding. Nothing: it is none.
std::optional<Bytes> bytes_of_base64(std::string_view text);
std::string to_base64(ByteView bytes);

}  // namespace porttape
