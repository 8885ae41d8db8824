#include "libport/formats/byte_text.hpp"

#include <fmt/format.h>

namespace porttape {
namespace {

constexpr std::int64_t kMostSeconds = 4'294'967'295;  // of a block's header
constexpr int kDecimals = 6;

bool is_decimal(char c) { return c >= '0' && c <= '9'; }
bool is_octal(char c) { return c >= '0' && c <= '7'; }

std::optional<Byte> simple_escape(char c) {
  constexpr std::string_view names = "abefnrtv\\\"'";
  constexpr std::string_view values = "\a\b\x1b\f\n\r\t\v\\\"'";
  const std::size_t at = names.find(c);
  if (at == std::string_view::npos) return std::nullopt;
  return static_cast<Byte>(values[at]);
}

// The byte that an escape (without its backslash) says; takes it off.
std::optional<Byte> take_escape(std::string_view& text) {
  if (text.empty()) return std::nullopt;
  if (const auto simple = simple_escape(text.front())) {
    text.remove_prefix(1);
    return simple;
  }
  unsigned value = 0;
  if (text.front() == 'x') {
    if (text.size() < 3) return std::nullopt;
    const auto high = hex_digit(text[1]);
    const auto low = hex_digit(text[2]);
    if (!high || !low) return std::nullopt;
    text.remove_prefix(3);
    return static_cast<Byte>(*high * 16 + *low);
  }
  if (!is_octal(text.front())) return std::nullopt;
  for (int digits = 0; digits < 3 && !text.empty() && is_octal(text.front()); ++digits) {
    value = value * 8 + static_cast<unsigned>(text.front() - '0');
    text.remove_prefix(1);
  }
  if (value > 0xff) return std::nullopt;
  return static_cast<Byte>(value);
}

}  // namespace

std::optional<std::int64_t> take_seconds_us(std::string_view& text) {
  std::string_view left = text;
  std::int64_t us = 0;
  if (left.empty() || !is_decimal(left.front())) return std::nullopt;
  for (; !left.empty() && is_decimal(left.front()); left.remove_prefix(1)) {
    us = us * 10 + (left.front() - '0');
    if (us > kMostSeconds) return std::nullopt;
  }
  int decimals = 0;
  if (left.starts_with('.')) {
    left.remove_prefix(1);
    for (; !left.empty() && is_decimal(left.front()) && decimals < kDecimals;
         left.remove_prefix(1), ++decimals)
      us = us * 10 + (left.front() - '0');
    if (decimals == 0 || (!left.empty() && is_decimal(left.front()))) return std::nullopt;
  }
  for (; decimals < kDecimals; ++decimals) us *= 10;
  text = left;
  return us;
}

std::string seconds_of_us(std::int64_t us) { return fmt::format("{}.{:06}", us / 1'000'000, us % 1'000'000); }

std::optional<Bytes> unescaped_bytes(std::string_view text, std::size_t& wrong_at) {
  Bytes bytes;
  bytes.reserve(text.size());
  for (std::string_view left = text; !left.empty();) {
    if (left.front() != '\\') {
      bytes.push_back(static_cast<Byte>(left.front()));
      left.remove_prefix(1);
      continue;
    }
    const std::size_t at = text.size() - left.size();
    left.remove_prefix(1);
    const auto byte = take_escape(left);
    if (!byte) {
      wrong_at = at;
      return std::nullopt;
    }
    bytes.push_back(*byte);
  }
  return bytes;
}

}  // namespace porttape
