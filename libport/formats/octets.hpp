#pragma once

#include <concepts>
#include <cstdint>
#include <string>

#include "libport/base/bytes.hpp"

namespace porttape {

enum class Endian : std::uint8_t { little, big };

// A number in bytes that are there: `at` + its size is at most their end.
template <std::unsigned_integral Number>
Number number_in(ByteView bytes, std::size_t at, Endian endian) {
  Number number = 0;
  for (std::size_t i = 0; i < sizeof(Number); ++i) {
    const std::size_t digit = endian == Endian::big ? i : sizeof(Number) - 1 - i;
    number = static_cast<Number>(number << 7U << 1U | bytes[at + digit]);
  }
  return number;
}

template <std::unsigned_integral Number>
void add_number(std::string& to, Number number, Endian endian) {
  for (std::size_t i = 0; i < sizeof(Number); ++i) {
    const std::size_t shift = 8 * (endian == Endian::little ? i : sizeof(Number) - 1 - i);
    to += static_cast<char>(static_cast<std::uint64_t>(number) >> shift & 0xffU);
  }
}

}  // namespace porttape
