#pragma once

#include <cstdint>
#include <optional>

namespace porttape {

enum class Parity : std::uint8_t { none, even, odd, mark, space };

// The settings of a serial line.
struct LineSettings {
  unsigned baud = 9600;    // bit/s; 0: hung up (B0), modem lines down
  unsigned data_bits = 8;  // 5 to 8
  Parity parity = Parity::none;
  unsigned stop_bits = 1;  // 1 or 2
  bool hw_flow = false;    // RTS/CTS
  bool sw_flow = false;    // XON/XOFF

  friend bool operator==(const LineSettings&, const LineSettings&) = default;
};

// What is known of a line's settings. A pty shows neither parity nor 5 to 7 data bits.
struct SeenSettings {
  std::optional<unsigned> baud = {};
  std::optional<unsigned> data_bits = {};
  std::optional<Parity> parity = {};
  std::optional<unsigned> stop_bits = {};
  std::optional<bool> hw_flow = {};
  std::optional<bool> sw_flow = {};

  static SeenSettings of(const LineSettings& all) {
    return {all.baud, all.data_bits, all.parity, all.stop_bits, all.hw_flow, all.sw_flow};
  }

  // What is known of these, else of `others`.
  [[nodiscard]] SeenSettings over(const SeenSettings& others) const {
    return {baud ? baud : others.baud,          data_bits ? data_bits : others.data_bits,
            parity ? parity : others.parity,    stop_bits ? stop_bits : others.stop_bits,
            hw_flow ? hw_flow : others.hw_flow, sw_flow ? sw_flow : others.sw_flow};
  }

  // These, and of `others` what is not known of them.
  [[nodiscard]] LineSettings over(const LineSettings& others) const {
    return {.baud = baud.value_or(others.baud),
            .data_bits = data_bits.value_or(others.data_bits),
            .parity = parity.value_or(others.parity),
            .stop_bits = stop_bits.value_or(others.stop_bits),
            .hw_flow = hw_flow.value_or(others.hw_flow),
            .sw_flow = sw_flow.value_or(others.sw_flow)};
  }

  friend bool operator==(const SeenSettings&, const SeenSettings&) = default;
};

// The place of a change among the bytes: `exact`, or found beside bytes that may have come before it.
enum class SettingsOrder : std::uint8_t { exact, sampled };

}  // namespace porttape
