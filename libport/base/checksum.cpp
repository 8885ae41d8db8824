#include "libport/base/checksum.hpp"

#include <boost/crc.hpp>

namespace porttape {
namespace {

using Algorithm = ChecksumKind::Algorithm;

template <std::size_t Bits>
std::uint32_t crc_of(const CrcParameters& parameters, ByteView bytes, std::optional<Byte> extra) {
  using Crc = boost::crc_basic<Bits>;
  using Value = typename Crc::value_type;
  Crc crc(static_cast<Value>(parameters.poly), static_cast<Value>(parameters.init),
          static_cast<Value>(parameters.xor_out), parameters.reflected, parameters.reflected);
  crc.process_bytes(bytes.data(), bytes.size());
  if (extra) crc.process_byte(*extra);
  return static_cast<std::uint32_t>(crc.checksum());
}

std::uint32_t crc_of(const CrcParameters& parameters, ByteView bytes, std::optional<Byte> extra) {
  switch (parameters.width) {
    case 8:
      return crc_of<8>(parameters, bytes, extra);
    case 16:
      return crc_of<16>(parameters, bytes, extra);
    case 24:
      return crc_of<24>(parameters, bytes, extra);
    default:
      return crc_of<32>(parameters, bytes, extra);
  }
}

// Fletcher's: of bytes in 16 bits, of little-endian words of two in 32; the last one is filled up with zero.
std::uint32_t fletcher(unsigned width, ByteView bytes) {
  const std::size_t step = width / 16;
  const std::uint32_t modulo = width == 16 ? 255 : 65535;
  std::uint32_t first = 0;
  std::uint32_t second = 0;
  for (std::size_t i = 0; i < bytes.size(); i += step) {
    std::uint32_t word = bytes[i];
    if (step == 2 && i + 1 < bytes.size()) word |= static_cast<std::uint32_t>(bytes[i + 1]) << 8;
    first = (first + word) % modulo;
    second = (second + first) % modulo;
  }
  return second << (width / 2) | first;
}

std::uint32_t fletcher_ubx(ByteView bytes) {
  std::uint32_t first = 0;
  std::uint32_t second = 0;
  for (const Byte byte : bytes) {
    first = (first + byte) & 0xff;
    second = (second + first) & 0xff;
  }
  return first << 8 | second;
}

std::uint32_t sum_of(ByteView bytes) {
  std::uint32_t sum = 0;
  for (const Byte byte : bytes) sum += byte;
  return sum;
}

std::uint32_t low_bits(std::uint32_t value, unsigned width) {
  return width >= 32 ? value : value & ((std::uint32_t{1} << width) - 1);
}

}  // namespace

std::uint32_t checksum_of(const ChecksumKind& kind, ByteView bytes, std::optional<Byte> extra) {
  const unsigned width = kind.crc.width;
  switch (kind.algorithm) {
    case Algorithm::crc:
      return crc_of(kind.crc, bytes, extra);
    case Algorithm::sum:
      return low_bits(sum_of(bytes), width);
    case Algorithm::negative_sum:
      return low_bits(~sum_of(bytes) + 1, width);
    case Algorithm::exclusive_or: {
      std::uint32_t value = 0;
      for (const Byte byte : bytes) value ^= byte;
      return value;
    }
    case Algorithm::fletcher:
      return fletcher(width, bytes);
    case Algorithm::fletcher_ubx:
      return fletcher_ubx(bytes);
    case Algorithm::scip:
      break;
  }
  return (sum_of(bytes) & 0x3f) + 0x30;
}

}  // namespace porttape
