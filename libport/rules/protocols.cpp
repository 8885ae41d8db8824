#include <array>

#include "libport/rules/framing.hpp"

namespace porttape {
namespace {

constexpr std::array<std::string_view, 8> kNames = {"gdb",        "mavlink", "modbus-ascii", "modbus-rtu",
                                                    "modbus-tcp", "nmea",    "scip",         "ubx"};

Bytes bytes_of(std::string_view text) { return Bytes(text.begin(), text.end()); }

// $GPGGA,…*5A and its line's end; AIS begins with an exclamation mark.
FrameFormat nmea(std::string_view start) {
  return {.kind = FrameFormat::Kind::delimited,
          .start = bytes_of(start),
          .end = bytes_of("\r\n"),
          .longest = 1024,
          .checksum = ChecksumField{.kind = "XOR", .at = -4, .from = 1, .to = -5, .hex = true}};
}

// Sync, class, message, length (little-endian), payload, two sums.
FrameFormat ubx() {
  return {.kind = FrameFormat::Kind::length,
          .start = {0xb5, 0x62},
          .length = {.at = 4, .size = 2, .order = ByteOrder::little, .adds = 8},
          .checksum = ChecksumField{.kind = "FLETCHER-UBX", .at = -2, .from = 2}};
}

FrameFormat modbus_rtu() {
  return {.kind = FrameFormat::Kind::idle,
          .idle = Micros{1750},
          .longest = 256,
          .checksum = ChecksumField{.kind = "CRC-16/MODBUS", .at = -2, .order = ByteOrder::little}};
}

FrameFormat modbus_tcp() {
  return {.kind = FrameFormat::Kind::length, .length = {.at = 4, .size = 2, .adds = 6}, .longest = 260};
}

FrameFormat modbus_ascii() {
  return {.kind = FrameFormat::Kind::delimited,
          .start = bytes_of(":"),
          .end = bytes_of("\r\n"),
          .longest = 513,
          .checksum = ChecksumField{.kind = "LRC", .at = -4, .from = 1, .hex = true, .of_hex = true}};
}

// $packet#checksum; what else stands between (acknowledgements) is no frame.
FrameFormat gdb() {
  return {.kind = FrameFormat::Kind::delimited,
          .start = bytes_of("$"),
          .end = bytes_of("#"),
          .trailer = 2,
          .longest = 65536,
          .checksum = ChecksumField{.kind = "SUM-8", .at = -2, .from = 1, .to = -3, .hex = true}};
}

// A line; the last character before its end is the checksum where the line has one (the device's lines do).
FrameFormat scip() {
  return {.kind = FrameFormat::Kind::delimited,
          .end = bytes_of("\n"),
          .checksum = ChecksumField{.kind = "SCIP", .at = -2, .from = 0}};
}

FrameFormat mavlink(bool second) {
  FrameFormat format{
      .kind = FrameFormat::Kind::length,
      .start = {static_cast<Byte>(second ? 0xfd : 0xfe)},
      .length = {.at = 1, .size = 1, .adds = second ? 12 : 8},
      .longest = 300,
      .checksum = ChecksumField{
          .kind = "CRC-16/MCRF4XX", .at = -2, .from = 1, .order = ByteOrder::little, .mavlink_extra = true}};
  if (second) format.length.signed_at = 2;
  return format;
}

}  // namespace

std::span<const std::string_view> protocol_names() { return kNames; }

std::vector<FrameFormat> protocol_formats(std::string_view protocol) {
  std::vector<FrameFormat> formats;
  if (protocol == "gdb") formats = {gdb()};
  if (protocol == "mavlink") formats = {mavlink(true), mavlink(false)};
  if (protocol == "modbus-ascii") formats = {modbus_ascii()};
  if (protocol == "modbus-rtu") formats = {modbus_rtu()};
  if (protocol == "modbus-tcp") formats = {modbus_tcp()};
  if (protocol == "nmea") formats = {nmea("$"), nmea("!")};
  if (protocol == "scip") formats = {scip()};
  if (protocol == "ubx") formats = {ubx()};
  for (FrameFormat& format : formats) format.protocol = protocol;
  return formats;
}

}  // namespace porttape
