#pragma once

#include <cstdint>
#include <optional>

#include "libport/formats/octets.hpp"

namespace porttape {

// What usbmon saw of a transfer: that a driver submitted it, or that it is done.
struct UsbUrb {
  enum class Transfer : std::uint8_t { isochronous, interrupt, control, bulk };

  std::uint64_t id = 0;
  bool submitted = false;
  Transfer transfer = Transfer::bulk;
  std::uint8_t endpoint = 0;  // without its direction
  bool in = false;
  std::uint16_t bus = 0;
  std::uint8_t address = 0;
  std::uint32_t length = 0;  // of the data, which may be more than was kept
  ByteView data;

  struct Setup {
    std::uint8_t type = 0;
    std::uint8_t request = 0;
    std::uint16_t value = 0;
    std::uint16_t index = 0;
  };
  std::optional<Setup> setup;

  // Link types of usbmon: with a head of 48 bytes, and of 64.
  static constexpr std::uint32_t kShortHead = 189;
  static constexpr std::uint32_t kLongHead = 220;
  // Nothing: too short, or an error event.
  static std::optional<UsbUrb> parse(std::uint32_t link_type, ByteView packet, Endian endian);
};

}  // namespace porttape
