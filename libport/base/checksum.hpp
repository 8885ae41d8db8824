#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "libport/base/bytes.hpp"

namespace porttape {

// The parameters of a CRC as the catalogue of CRC algorithms (reveng) writes them.
struct CrcParameters {
  unsigned width = 8;  // bits: 8, 16, 24 or 32
  std::uint32_t poly = 0;
  std::uint32_t init = 0;
  bool reflected = false;  // both ways in
  std::uint32_t xor_out = 0;
};

// A way to compute a checksum, with a name.
struct ChecksumKind {
  enum class Algorithm : std::uint8_t {
    crc,
    sum,           // of the bytes, in `width` bits
    negative_sum,  // two's complement of that: LRC
    exclusive_or,  // of the bytes
    fletcher,  // two sums in half of `width` bits each, modulo 2^n - 1 of bytes or words; the second first
    fletcher_ubx,  // two sums modulo 256, the first first
    scip           // the low six bits of the sum, and 0x30
  };
  std::string_view name;
  Algorithm algorithm = Algorithm::sum;
  CrcParameters crc{};
  std::uint32_t check = 0;  // of "123456789"

  [[nodiscard]] std::size_t size() const { return crc.width / 8; }  // bytes
};

// All there are, CRCs first.
std::span<const ChecksumKind> checksum_kinds();
// By its name or an alias ("CRC-16", "CRC-32C", "lrc", …), whatever the case; null: there is none.
const ChecksumKind* find_checksum(std::string_view name);

// `extra`: a byte that goes in last.
std::uint32_t checksum_of(const ChecksumKind& kind, ByteView bytes, std::optional<Byte> extra = {});

}  // namespace porttape
