#include "libport/infer/known_sorts.hpp"

#include <array>
#include <span>

#include "libport/rules/framing.hpp"

namespace porttape {
namespace {

// What tells the kinds, by protocol and, where it has several formats, by the byte that they start with.
struct KeyRow {
  std::string_view protocol;
  int start;  // -1: any
  std::size_t at;
  std::size_t size;  // 0: a text's first word
  std::string_view whole_words;
};
constexpr std::array kKeys = {
    KeyRow{"mavlink", 0xfd, 7, 3, ""},    KeyRow{"mavlink", 0xfe, 5, 1, ""}, KeyRow{"ubx", -1, 2, 2, ""},
    KeyRow{"modbus-ascii", -1, 3, 2, ""}, KeyRow{"nmea", -1, 0, 0, ""},      KeyRow{"gdb", -1, 0, 0, "qQvb"},
};

std::vector<FrameSort> sorts_of(std::string_view protocol) {
  std::vector<FrameSort> sorts;
  for (FrameFormat& format : protocol_formats(protocol)) {
    FrameSort sort;
    for (const KeyRow& key : kKeys) {
      if (key.protocol != protocol || (key.start >= 0 && format.start.front() != key.start)) continue;
      sort.text = key.size == 0;
      sort.key_at = key.at;
      sort.key_size = key.size;
      sort.whole_words = key.whole_words;
    }
    format.name = protocol;
    sort.format = std::move(format);
    sorts.push_back(std::move(sort));
  }
  return sorts;
}

FrameSort one_byte(std::string name, Byte byte) {
  FrameSort sort;
  sort.format.name = std::move(name);
  sort.format.kind = FrameFormat::Kind::fixed;
  sort.format.start = {byte};
  sort.format.size = 1;
  return sort;
}

KnownRow row(std::string name, std::initializer_list<std::string_view> protocols,
             std::vector<FrameSort> more = {}) {
  KnownRow all{std::move(name), {}};
  for (const std::string_view protocol : protocols)
    for (FrameSort& sort : sorts_of(protocol)) all.sorts.push_back(std::move(sort));
  for (FrameSort& sort : more) all.sorts.push_back(std::move(sort));
  return all;
}

}  // namespace

const std::vector<KnownRow>& known_rows() {
  static const std::vector<KnownRow> rows{
      row("MAVLink", {"mavlink"}),
      row("UBX", {"ubx"}),
      row("NMEA", {"nmea"}),
      row("UBX and NMEA", {"ubx", "nmea"}),
      row("gdb's remote protocol", {"gdb"},
          {one_byte("ack", '+'), one_byte("nak", '-'), one_byte("interrupt", 0x03)}),
      row("Modbus ASCII", {"modbus-ascii"}),
  };
  return rows;
}

}  // namespace porttape
