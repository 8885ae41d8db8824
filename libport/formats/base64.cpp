#include "libport/formats/base64.hpp"

#include <algorithm>

namespace porttape {
namespace {

constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

}  // namespace

std::optional<Bytes> bytes_of_base64(std::string_view text) {
  if (text.size() % 4 != 0) return std::nullopt;
  for (int i = 0; i < 2 && text.ends_with('='); ++i) text.remove_suffix(1);
  Bytes bytes;
  std::uint32_t pool = 0;
  unsigned bits = 0;
  for (const char c : text) {
    const std::size_t digit = kDigits.find(c);
    if (digit == std::string_view::npos) return std::nullopt;
    pool = (pool << 6U | static_cast<std::uint32_t>(digit)) & 0xffffU;
    bits += 6;
    if (bits < 8) continue;
    bits -= 8;
    bytes.push_back(static_cast<Byte>(pool >> bits & 0xffU));
  }
  return bytes;
}

std::string to_base64(ByteView bytes) {
  std::string text;
  for (std::size_t at = 0; at < bytes.size(); at += 3) {
    const std::size_t left = std::min<std::size_t>(bytes.size() - at, 3);
    std::uint32_t pool = 0;
    for (std::size_t i = 0; i < 3; ++i) pool = pool << 8U | (i < left ? bytes[at + i] : 0U);
    for (std::size_t i = 0; i < 4; ++i) text += i <= left ? kDigits[pool >> (18 - 6 * i) & 0x3fU] : '=';
  }
  return text;
}

}  // namespace porttape
