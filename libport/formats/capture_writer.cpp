#include "libport/formats/capture_writer.hpp"

#include <algorithm>

#include "libport/formats/octets.hpp"

namespace porttape {
namespace {

constexpr std::size_t kMostOfText = 1024;

void put16(std::string& to, std::uint32_t number) {
  add_number(to, static_cast<std::uint16_t>(number), Endian::little);
}
void put32(std::string& to, std::uint64_t number) {
  add_number(to, static_cast<std::uint32_t>(number), Endian::little);
}

void pad(std::string& to) { to.append((4 - to.size() % 4) % 4, '\0'); }

void put_option(std::string& to, std::uint16_t code, std::string_view value) {
  put16(to, code);
  put16(to, static_cast<std::uint16_t>(value.size()));
  to += value;
  pad(to);
}

// Of a name; nothing where there is none.
void put_text(std::string& to, std::uint16_t code, std::string_view text) {
  if (!text.empty()) put_option(to, code, text.substr(0, kMostOfText));
}

void end_options(std::string& to) { put32(to, 0); }

}  // namespace

Result<void> PcapngWriter::block(std::uint32_t type, std::string_view body) {
  std::string framed;
  const std::size_t length = body.size() + 12;
  put32(framed, type);
  put32(framed, length);
  framed += body;
  put32(framed, length);
  return to_.add(framed);
}

Result<void> PcapngWriter::begin(const Section& section) {
  std::string body;
  put32(body, 0x1a2b3c4d);
  put16(body, 1);
  put16(body, 0);
  add_number(body, ~std::uint64_t{0}, Endian::little);  // its length is not told
  for (const std::string& comment : section.comments) put_option(body, 1, comment);
  put_text(body, 2, section.hardware);
  put_text(body, 3, section.os);
  put_text(body, 4, section.program);
  end_options(body);
  if (Result<void> written = block(0x0a0d0d0a, body); !written) return written;
  body.clear();
  put16(body, section.link_type);
  put16(body, 0);
  put32(body, 0);  // packets are whole
  put_text(body, 2, section.interface);
  put_option(body, 9, "\x06");  // microseconds
  end_options(body);
  return block(1, body);
}

Result<void> PcapngWriter::add(const PacketToWrite& packet) {
  const std::size_t length = packet.head.size() + packet.data.size();
  std::string body;
  put32(body, 0);
  put32(body, packet.us >> 32U);
  put32(body, packet.us);
  put32(body, length);
  put32(body, length);
  body += packet.head;
  body += as_text(packet.data);
  pad(body);
  for (const std::string& comment : packet.comments) put_option(body, 1, comment);
  if (packet.way != CaptureWay::none) {
    std::string flags;
    put32(flags, packet.way == CaptureWay::inbound ? 1 : 2);
    put_option(body, 2, flags);
  }
  if (packet.way != CaptureWay::none || !packet.comments.empty()) end_options(body);
  return block(6, body);
}

Result<void> PcapWriter::begin(std::uint32_t link_type) {
  constexpr std::uint32_t kSnapLength = 262'144;
  std::string head;
  put32(head, 0xa1b2c3d4);
  put16(head, 2);
  put16(head, 4);
  put32(head, 0);
  put32(head, 0);
  put32(head, kSnapLength);
  put32(head, link_type);
  return to_.add(head);
}

Result<void> PcapWriter::add(const PacketToWrite& packet) {
  constexpr std::uint64_t kSecond = 1'000'000;
  const std::size_t length = packet.head.size() + packet.data.size();
  std::string record;
  put32(record, packet.us / kSecond);
  put32(record, packet.us % kSecond);
  put32(record, length);
  put32(record, length);
  record += packet.head;
  record += as_text(packet.data);
  return to_.add(record);
}

}  // namespace porttape
