#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "libport/base/bytes.hpp"

namespace porttape {

// A time in seconds with up to six decimals, exact: "12", "0.000345". Takes it off the text's front; nothing,
// and the text as it was, where there is none or it is over 136 years.
std::optional<std::int64_t> take_seconds_us(std::string_view& text);
// With six decimals.
std::string seconds_of_us(std::int64_t us);

// The bytes of text as C writes it in a string, without the quotes (to_printable() writes it): \n \r \t \e
// \\ \" \xHH of two digits, \a, \b, \f, \v, \', \N to \NNN (octal). Where it is wrong: nothing, and
// `wrong_at` says where in the text.
std::optional<Bytes> unescaped_bytes(std::string_view text, std::size_t& wrong_at);

}  // namespace porttape
