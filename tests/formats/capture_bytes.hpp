#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "libport/formats/octets.hpp"

namespace porttape::test {

// Captures as others write them, put together by their documents alone.
class CaptureBytes {
 public:
  explicit CaptureBytes(Endian endian = Endian::little) : endian_(endian) {}

  CaptureBytes& u8(unsigned number) {
    bytes_ += static_cast<char>(number);
    return *this;
  }
  CaptureBytes& u16(unsigned number) {
    add_number(bytes_, static_cast<std::uint16_t>(number), endian_);
    return *this;
  }
  CaptureBytes& u32(std::uint64_t number) {
    add_number(bytes_, static_cast<std::uint32_t>(number), endian_);
    return *this;
  }
  CaptureBytes& u64(std::uint64_t number) {
    add_number(bytes_, number, endian_);
    return *this;
  }
  CaptureBytes& text(std::string_view text) {
    bytes_ += text;
    return *this;
  }
  CaptureBytes& pad() {
    bytes_.append((4 - bytes_.size() % 4) % 4, '\0');
    return *this;
  }
  CaptureBytes& option(unsigned code, std::string_view value) {
    return u16(code).u16(static_cast<unsigned>(value.size())).text(value).pad();
  }
  [[nodiscard]] const std::string& str() const { return bytes_; }
  [[nodiscard]] CaptureBytes other() const { return CaptureBytes(endian_); }

  // Blocks of pcapng.
  CaptureBytes& block(std::uint32_t type, std::string_view body) {
    const std::size_t length = (body.size() + 3) / 4 * 4 + 12;
    return u32(type).u32(length).text(body).pad().u32(length);
  }
  CaptureBytes& section() {
    return block(0x0a0d0d0a, other().u32(0x1a2b3c4d).u16(1).u16(0).u64(~std::uint64_t{0}).str());
  }
  CaptureBytes& interface(unsigned link_type, std::string_view name = "", int resolution = -1) {
    CaptureBytes body = other().u16(link_type).u16(0).u32(0);
    if (!name.empty()) body.option(2, name);
    if (resolution >= 0) body.option(9, std::string(1, static_cast<char>(resolution)));
    return block(1, body.u32(0).str());
  }
  CaptureBytes& packet(unsigned interface, std::uint64_t time, std::string_view data) {
    CaptureBytes body = other().u32(interface).u32(time >> 32U).u32(time);
    return block(6, body.u32(data.size()).u32(data.size()).text(data).str());
  }
  // pcap.
  CaptureBytes& pcap(unsigned link_type, std::uint32_t magic = 0xa1b2c3d4) {
    return u32(magic).u16(2).u16(4).u32(0).u32(0).u32(65'535).u32(link_type);
  }
  CaptureBytes& record(std::uint64_t second, std::uint64_t part, std::string_view data) {
    return u32(second).u32(part).u32(data.size()).u32(data.size()).text(data);
  }

 private:
  Endian endian_;
  std::string bytes_;
};

// A packet of RTAC serial.
inline std::string rtac_packet(unsigned what, unsigned lines, std::string_view bytes) {
  return CaptureBytes(Endian::big).u32(0).u32(0).u8(what).u8(lines).u16(0).text(bytes).str();
}

}  // namespace porttape::test
