#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "tests/formats/capture_bytes.hpp"

namespace porttape::test {

// What usbmon writes, by its documents (Documentation/usb/usbmon.rst, libpcap's pcap/usb.h).
class UsbCapture {
 public:
  explicit UsbCapture(Endian endian = Endian::little, bool long_head = true)
      : endian_(endian), long_(long_head), file_(endian) {
    file_.pcap(long_ ? 220 : 189);
  }

  UsbCapture& at(std::uint64_t us) {
    us_ = us;
    return *this;
  }
  UsbCapture& device(unsigned address) {
    address_ = address;
    return *this;
  }

  UsbCapture& out(unsigned endpoint, std::string_view data) {
    ++id_;
    packet('S', 3, endpoint, data, data.size(), nullptr);
    return packet('C', 3, endpoint, "", data.size(), nullptr);
  }
  UsbCapture& in(unsigned endpoint, std::string_view data) {
    ++id_;
    packet('S', 3, 0x80U | endpoint, "", 64, nullptr);
    return packet('C', 3, 0x80U | endpoint, data, data.size(), nullptr);
  }
  UsbCapture& interrupt(unsigned endpoint, std::string_view data) {
    ++id_;
    return packet('C', 1, 0x80U | endpoint, data, data.size(), nullptr);
  }
  UsbCapture& control(unsigned type, unsigned request, unsigned value, unsigned index,
                      std::string_view data = "") {
    ++id_;
    const std::string setup = CaptureBytes()
                                  .u8(type)
                                  .u8(request)
                                  .u16(value)
                                  .u16(index)
                                  .u16(static_cast<unsigned>(data.size()))
                                  .str();
    const bool is_in = (type & 0x80U) != 0;
    packet('S', 2, is_in ? 0x80 : 0, is_in ? "" : data, data.size(), &setup);
    return packet('C', 2, is_in ? 0x80 : 0, is_in ? data : "", data.size(), nullptr);
  }
  UsbCapture& descriptor(unsigned vendor, unsigned version = 0x0100) {
    return control(0x80, 6, 0x0100, 0,
                   CaptureBytes()
                       .u8(18)
                       .u8(1)
                       .u16(0x0200)
                       .u32(0x40000000)
                       .u16(vendor)
                       .u16(0x1234)
                       .u16(version)
                       .u32(0)
                       .str());
  }

  [[nodiscard]] const std::string& str() const { return file_.str(); }

 private:
  UsbCapture& packet(char event, unsigned transfer, unsigned endpoint, std::string_view data,
                     std::size_t length, const std::string* setup) {
    constexpr std::uint64_t kMillion = 1'000'000;
    CaptureBytes head(endian_);
    head.u64(id_).u8(static_cast<unsigned char>(event)).u8(transfer).u8(endpoint).u8(address_).u16(1);
    head.u8(setup != nullptr ? 0 : '-').u8(data.empty() ? (event == 'S' ? '<' : '>') : 0);
    head.u64(us_ / kMillion).u32(us_ % kMillion).u32(0).u32(length).u32(data.size());
    head.text(setup != nullptr ? *setup : std::string(8, '\0'));
    if (long_) head.u32(0).u32(0).u32(0).u32(0);
    file_.record(us_ / kMillion, us_ % kMillion, head.text(data).str());
    return *this;
  }

  Endian endian_;
  bool long_;
  CaptureBytes file_;
  std::uint64_t id_ = 0xffff8880'00000000;
  std::uint64_t us_ = 1'700'000'000'000'000;
  unsigned address_ = 5;
};

}  // namespace porttape::test
