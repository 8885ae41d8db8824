#include <array>
#include <cinttypes>
#include <cstdio>

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

std::string member_if(std::string_view key, std::string_view text) {
  return text.empty() ? std::string() : member(key, text);
}

std::string number(std::string_view key, std::uint64_t value) {
  return ",\"" + std::string(key) + "\":" + std::to_string(value);
}

// An object of members, each of which begins with a comma.
std::string object(std::string_view key, const std::string& members) {
  return ",\"" + std::string(key) + "\":{" + members.substr(1) + "}";
}

std::string zero_member(const TapeZero& zero) {
  return object("zero", member("wall", zero.wall) +
                            number("monotonic_us", static_cast<std::uint64_t>(zero.monotonic_us)) +
                            member_if("boot", zero.boot));
}

std::string totals_member(std::string_view key, const PayloadTotals& totals) {
  std::string digest;
  if (totals.xxh3) {
    std::array<char, 17> hex{};
    std::snprintf(hex.data(), hex.size(), "%016" PRIx64, *totals.xxh3);
    digest = member("xxh3", hex.data());
  }
  return object(key, number("blocks", totals.blocks) + number("bytes", totals.bytes) + digest);
}

}  // namespace

std::string header_line(const TapeHeader& header) {
  std::string line = R"({"format":"porttape-events","version":1)" + member("created", header.created) +
                     member_if("id", header.id);
  if (header.zero) line += zero_member(*header.zero);
  line += member("device", header.device) + member("driver", header.driver);
  if (header.transport) {
    line += member("transport", *header.transport == Transport::datagram ? "datagram" : "stream");
  }
  if (header.stamped) line += member("stamped", *header.stamped == Stamped::arrival ? "arrival" : "read");
  if (header.previous) {
    line += object("previous", member("id", header.previous->id) + member("name", header.previous->name));
  }
  return line + member("host", header.host) + member("tool", header.tool) + "}\n";
}

std::string event_line(TapeTime at, std::string_view kind) { return beginning(at, kind) + "}\n"; }

std::string mark_line(TapeTime at, std::string_view text) {
  return beginning(at, "mark") + member("text", text) + "}\n";
}

std::string device_lost_line(TapeTime at, std::string_view why, bool hung_up) {
  return beginning(at, "device-lost") + member("why", why) + (hung_up ? ",\"hung_up\":true}\n" : "}\n");
}

std::string half_close_line(TapeTime at, std::string_view by) {
  return beginning(at, "half-close") + member("by", by) + "}\n";
}

std::string end_line(TapeTime at, const PayloadTotals& read, const PayloadTotals& write) {
  return beginning(at, "end") + totals_member("read", read) + totals_member("write", write) + "}\n";
}

std::string flush_line(TapeTime at, std::string_view queue) {
  return beginning(at, "flush") + member("queue", queue) + "}\n";
}

std::string gap_line(TapeTime at, std::uint64_t bytes, TapeTime from, std::string_view why) {
  return beginning(at, "gap") + ",\"bytes\":" + std::to_string(bytes) +
         ",\"from_us\":" + std::to_string(to_us(from)) + member("why", why) + "}\n";
}

}  // namespace porttape
