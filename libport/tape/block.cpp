#include "libport/tape/block.hpp"

#include <cstdio>

namespace porttape {
namespace {

void store_be32(Byte* p, std::uint64_t value) {
  for (std::size_t i = 0; i < 4; ++i) p[i] = static_cast<Byte>(value >> (24U - 8U * i));
}

std::string seconds_text(std::int64_t us) {
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%.6f s", static_cast<double>(us) / 1e6);
  return text.data();
}

}  // namespace

std::string_view to_string(Layout layout) {
  return layout == Layout::big_endian ? "big-endian" : "native 64-bit";
}

std::array<Byte, kHeaderSize> encode_header(TapeTime at, std::uint32_t length) {
  const auto us = static_cast<std::uint64_t>(to_us(at));
  std::array<Byte, kHeaderSize> header{};
  store_be32(header.data(), us / 1'000'000);
  store_be32(header.data() + 4, us % 1'000'000);
  store_be32(header.data() + 8, length);
  return header;
}

std::string describe(HeaderFault fault, const BlockHeader& header, std::int64_t not_before_us) {
  switch (fault) {
    case HeaderFault::none:
      break;
    case HeaderFault::microseconds:
      return "microseconds are " + std::to_string(header.microseconds) + ", not below 1000000";
    case HeaderFault::seconds:
      return "seconds are " + std::to_string(static_cast<std::int64_t>(header.seconds)) +
             ", not from 0 to 4294967295";
    case HeaderFault::length:
      return "a block of " + std::to_string(header.length) + " bytes";
    case HeaderFault::time_back:
      return "time goes back from " + seconds_text(not_before_us) + " to " +
             seconds_text(header_time_us(header));
  }
  return "no fault";
}

}  // namespace porttape
