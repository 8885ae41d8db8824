#pragma once

#include <cstdint>
#include <functional>

#include "libport/base/bytes.hpp"
#include "libport/line/line_settings.hpp"

namespace porttape {

// What a UART makes of a line's levels. Times are sample numbers, and never go back. Pure.
class UartDecoder {
 public:
  struct Frame {
    std::uint64_t begin = 0;  // of the start bit
    std::uint64_t end = 0;    // of the stop bit
    Byte byte = 0;
    bool parity_error = false;
    bool framing_error = false;  // the stop bit is low
    bool is_break = false;       // low all the time
  };
  using Take = std::function<void(const Frame&)>;

  // `samples_per_bit`: at least 2.
  UartDecoder(double samples_per_bit, const LineSettings& line, Take take);

  // The line is high or low from there on; high before the first call.
  void level(std::uint64_t at, bool high);
  // It has not changed before `to`.
  void advance(std::uint64_t to);

  [[nodiscard]] bool idle() const { return !in_frame_; }

 private:
  void sampled(bool high);
  void finish();
  [[nodiscard]] std::uint64_t bit_at(double bits) const;

  double samples_per_bit_;
  LineSettings line_;
  Take take_;
  bool high_ = true;
  bool in_frame_ = false;
  unsigned bit_ = 0;        // 0: the start bit
  std::uint64_t next_ = 0;  // when it is looked at
  std::uint32_t bits_ = 0;
  Frame frame_;
};

// Bits of a byte on the line, with start, parity and stop bits.
unsigned uart_bits(const LineSettings& line);
// These, the first in the lowest place.
std::uint32_t uart_word(Byte byte, const LineSettings& line);

}  // namespace porttape
