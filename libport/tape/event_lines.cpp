#include "libport/base/json_text.hpp"
#include "libport/tape/events.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMaxText = 4096;

// Cut between two characters.
std::string_view shortened(std::string_view text) {
  if (text.size() <= kMaxText) return text;
  std::size_t length = kMaxText;
  while (length > kMaxText - 4 && (static_cast<unsigned char>(text[length]) & 0xC0U) == 0x80U) --length;
  return text.substr(0, length);
}

std::string member(std::string_view key, std::string_view text) {
  return ",\"" + std::string(key) + "\":" + json_quote(shortened(text));
}

std::string beginning(TapeTime at, std::string_view kind) {
  return "{\"t_us\":" + std::to_string(to_us(at)) + ",\"event\":" + json_quote(kind);
}

}  // namespace

std::string header_line(const TapeHeader& header) {
  return R"({"format":"porttape-events","version":1)" + member("created", header.created) +
         member("device", header.device) + member("driver", header.driver) + member("host", header.host) +
         member("tool", header.tool) + "}\n";
}

std::string event_line(TapeTime at, std::string_view kind) { return beginning(at, kind) + "}\n"; }

std::string mark_line(TapeTime at, std::string_view text) {
  return beginning(at, "mark") + member("text", text) + "}\n";
}

std::string device_lost_line(TapeTime at, std::string_view why, bool hung_up) {
  return beginning(at, "device-lost") + member("why", why) + (hung_up ? ",\"hung_up\":true}\n" : "}\n");
}

std::string flush_line(TapeTime at, std::string_view queue) {
  return beginning(at, "flush") + member("queue", queue) + "}\n";
}

std::string gap_line(TapeTime at, std::uint64_t bytes, TapeTime from, std::string_view why) {
  return beginning(at, "gap") + ",\"bytes\":" + std::to_string(bytes) +
         ",\"from_us\":" + std::to_string(to_us(from)) + member("why", why) + "}\n";
}

}  // namespace porttape
