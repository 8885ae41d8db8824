#include "libport/replay/report_words.hpp"

#include <algorithm>
#include <array>
#include <cstdio>

namespace porttape {
namespace {

constexpr std::size_t kMostQuoted = 16;

bool is_readable(Byte byte) {
  return (byte >= 0x20 && byte < 0x7F) || byte == '\n' || byte == '\r' || byte == '\t';
}

}  // namespace

std::string millis_text(Micros time) {
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "%.3f", static_cast<double>(time.count()) / 1000.0);
  std::string number = text.data();
  number.erase(number.find_last_not_of('0') + 1);
  if (number.back() == '.') number.pop_back();
  return number + " ms";
}

std::string counted(std::uint64_t count, std::string_view noun) {
  return std::to_string(count) + ' ' + std::string(noun) + (count == 1 ? "" : "s");
}

std::string number_word(std::uint64_t number) {
  constexpr std::array<std::string_view, 11> words = {"no",  "one",   "two",   "three", "four", "five",
                                                      "six", "seven", "eight", "nine",  "ten"};
  return number < words.size() ? std::string(words.at(number)) : std::to_string(number);
}

std::string spaced_hex(ByteView bytes) {
  std::string out;
  for (const Byte byte : bytes) {
    if (!out.empty()) out += ' ';
    out += to_hex(ByteView(&byte, 1));
  }
  return out;
}

std::string bytes_text(ByteView before, ByteView bytes) {
  const ByteView front = before.last(std::min(before.size(), kMostQuoted));
  const ByteView back = bytes.first(std::min(bytes.size(), kMostQuoted));
  Bytes all(front.begin(), front.end());
  all.insert(all.end(), back.begin(), back.end());
  const auto readable = std::ranges::count_if(all, is_readable);
  const bool is_text = static_cast<std::size_t>(readable) * 2 >= all.size();
  return (front.size() < before.size() ? ".." : "") +
         (is_text ? '"' + to_printable(all) + '"' : spaced_hex(all)) +
         (back.size() < bytes.size() ? ".." : "");
}

std::string named_bytes(ByteView bytes) {
  const ByteView shown = bytes.first(std::min(bytes.size(), kMostQuoted));
  const std::string hex = spaced_hex(shown) + (shown.size() < bytes.size() ? " .." : "");
  const bool is_text = std::ranges::all_of(shown, is_readable);
  return is_text ? '"' + to_printable(shown) + "\" (" + hex + ')' : hex;
}

std::string wrote_text(const Roles& roles, std::string_view what) {
  return std::string(roles.one) + ' ' + std::string(roles.wrote) + ' ' + std::string(what);
}

}  // namespace porttape
