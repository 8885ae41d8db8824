#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"
#include "libport/replay/roles.hpp"

namespace porttape {

// Pieces of the sentences that reports are made of.

// "12.345 ms", without the zeros at its end.
std::string millis_text(Micros time);
// "1 byte", "3 bytes"
std::string counted(std::uint64_t count, std::string_view noun);
// "no", "one", "two", …, in digits beyond ten.
std::string number_word(std::uint64_t number);
// "0a 1b"
std::string spaced_hex(ByteView bytes);
// Bytes as a person reads them in a sentence: in quotes where they are text, else in hex; at most 16 of each.
// `before` goes before them, of the same write.
std::string bytes_text(ByteView before, ByteView bytes);
inline std::string bytes_text(ByteView bytes) { return bytes_text({}, bytes); }
// One or a few bytes that are the point of a sentence: text and hex.
std::string named_bytes(ByteView bytes);
// "the driver wrote …"
std::string wrote_text(const Roles& roles, std::string_view what);

}  // namespace porttape
