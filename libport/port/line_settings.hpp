#pragma once

#include <cstdint>

namespace porttape {

enum class Parity : std::uint8_t { none, even, odd };

// The settings of a serial line.
struct LineSettings {
  unsigned baud = 9600;    // bit/s
  unsigned data_bits = 8;  // 5 to 8
  Parity parity = Parity::none;
  unsigned stop_bits = 1;  // 1 or 2
  bool hw_flow = false;    // RTS/CTS
  bool sw_flow = false;    // XON/XOFF

  friend bool operator==(const LineSettings&, const LineSettings&) = default;
};

}  // namespace porttape
