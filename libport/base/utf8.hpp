#pragma once

#include <cstddef>
#include <string_view>

namespace porttape {

// Length of the well-formed UTF-8 sequence at the front, 0 if there is none (RFC 3629: no overlong forms, no
// surrogates).
std::size_t utf8_length(std::string_view text);

// The character of a well-formed sequence, all of `text`.
char32_t utf8_character(std::string_view text);

}  // namespace porttape
