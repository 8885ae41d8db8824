#include "libport/rules/frame_command.hpp"

#include <algorithm>
#include <fmt/format.h>

#include "libport/base/printable.hpp"

namespace porttape {
namespace {

constexpr std::size_t kLongestWord = 24;
constexpr std::size_t kHexShown = 4;

bool is_text(ByteView bytes) {
  return std::all_of(bytes.begin(), bytes.end(), [](Byte byte) {
    return (byte >= 0x20 && byte < 0x7f) || (byte >= '\t' && byte <= '\r');
  });
}

bool is_letter(Byte byte) { return (byte >= 'a' && byte <= 'z') || (byte >= 'A' && byte <= 'Z'); }
bool is_blank(Byte byte) { return byte <= ' '; }

// "MD" of "MD0044072501", "*IDN" of "*IDN?", "M115" whole: marks, letters, and the digits behind one letter.
std::string first_word(ByteView text) {
  const auto begin = std::find_if_not(text.begin(), text.end(), is_blank);
  auto end = std::find_if(begin, text.end(), [](Byte byte) { return is_letter(byte) || is_blank(byte); });
  const auto letters = end;
  end = std::find_if_not(end, text.end(), is_letter);
  if (end - letters == 1)
    end = std::find_if_not(end, text.end(), [](Byte byte) { return byte >= '0' && byte <= '9'; });
  if (letters == end) end = std::find_if(begin, text.end(), is_blank);
  std::string word(begin, end);
  if (word.size() > kLongestWord) word.resize(kLongestWord);
  if (word.empty()) return "(empty)";
  return word.find_first_not_of("+-.0123456789") == std::string::npos ? "(number)" : word;
}

std::string first_bytes(ByteView bytes) {
  const ByteView shown = bytes.first(std::min(bytes.size(), kHexShown));
  return to_hex(shown) + (shown.size() < bytes.size() ? "..." : "");
}

int byte_at(ByteView frame, std::size_t at) { return at < frame.size() ? frame[at] : 0; }

std::string modbus_command(int unit, int function) {
  return fmt::format("unit {} {} {}", unit, (function & 0x80) != 0 ? "exception" : "function",
                     function & 0x7f);
}

int hex_pair(ByteView frame, std::size_t at) {
  if (frame.size() < at + 2) return 0;
  const auto bytes = bytes_of_hex(as_text(frame.subspan(at, 2)));
  return bytes && !bytes->empty() ? bytes->front() : 0;
}

std::string mavlink_command(ByteView frame) {
  const bool second = byte_at(frame, 0) == 0xfd;
  const int id =
      second ? byte_at(frame, 7) | byte_at(frame, 8) << 8 | byte_at(frame, 9) << 16 : byte_at(frame, 5);
  return fmt::format("message {}", id);
}

std::string column_word(ByteView frame) {
  const auto end = std::find_if(frame.begin(), frame.end(),
                                [](Byte byte) { return byte == ',' || byte == '*' || byte < ' '; });
  return printable_line(std::string(frame.begin(), end)).substr(0, kLongestWord);
}

}  // namespace

std::string frame_command(const FrameFormat* format, ByteView frame) {
  const std::string_view protocol =
      format != nullptr ? std::string_view(format->protocol) : std::string_view();
  if (protocol == "nmea") return column_word(frame.subspan(std::min<std::size_t>(1, frame.size())));
  if (protocol == "ubx")
    return fmt::format("class {:02x} message {:02x}", byte_at(frame, 2), byte_at(frame, 3));
  if (protocol == "modbus-rtu") return modbus_command(byte_at(frame, 0), byte_at(frame, 1));
  if (protocol == "modbus-tcp") return modbus_command(byte_at(frame, 6), byte_at(frame, 7));
  if (protocol == "modbus-ascii") return modbus_command(hex_pair(frame, 1), hex_pair(frame, 3));
  if (protocol == "mavlink") return mavlink_command(frame);
  const std::size_t start = format != nullptr ? std::min(format->start.size(), frame.size()) : 0;
  const ByteView body = frame.subspan(start);
  return is_text(body) ? first_word(body) : first_bytes(body);
}

}  // namespace porttape
