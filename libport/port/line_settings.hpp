#pragma once

#include <cstdint>
#include <optional>

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

// What a line shows of the settings that its peer has made. A pty shows neither parity nor 5 to 7 data bits.
struct SeenSettings {
  unsigned baud = 9600;
  std::optional<unsigned> data_bits = {};
  std::optional<Parity> parity = {};
  unsigned stop_bits = 1;
  bool hw_flow = false;
  bool sw_flow = false;

  // These, and of `others` what is not known of them.
  [[nodiscard]] LineSettings over(const LineSettings& others) const;

  friend bool operator==(const SeenSettings&, const SeenSettings&) = default;
};

}  // namespace porttape
