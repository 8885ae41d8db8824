#include "libport/formats/uart_decoder.hpp"

#include <bit>
#include <cmath>
#include <utility>

namespace porttape {
namespace {

bool parity_bit(unsigned data, Parity parity) {
  const bool odd = std::popcount(data) % 2 == 1;
  return parity == Parity::mark || (parity == Parity::even && odd) || (parity == Parity::odd && !odd);
}

unsigned parity_bits(const LineSettings& line) { return line.parity == Parity::none ? 0 : 1; }

}  // namespace

unsigned uart_bits(const LineSettings& line) {
  return 1 + line.data_bits + parity_bits(line) + line.stop_bits;
}

std::uint32_t uart_word(Byte byte, const LineSettings& line) {
  const std::uint32_t data = byte & ((1U << line.data_bits) - 1);
  std::uint32_t word = data << 1U;
  unsigned at = 1 + line.data_bits;
  if (line.parity != Parity::none) word |= (parity_bit(data, line.parity) ? 1U : 0U) << at++;
  return word | ((1U << line.stop_bits) - 1) << at;
}

UartDecoder::UartDecoder(double samples_per_bit, const LineSettings& line, Take take)
    : samples_per_bit_(samples_per_bit), line_(line), take_(std::move(take)) {}

std::uint64_t UartDecoder::bit_at(double bits) const {
  return frame_.begin + static_cast<std::uint64_t>(std::llround(bits * samples_per_bit_));
}

void UartDecoder::level(std::uint64_t at, bool high) {
  advance(at);
  const bool falls = high_ && !high;
  high_ = high;
  if (in_frame_ || !falls) return;
  in_frame_ = true;
  frame_ = Frame{};
  frame_.begin = at;
  bits_ = 0;
  bit_ = 0;
  next_ = bit_at(0.5);
}

void UartDecoder::advance(std::uint64_t to) {
  while (in_frame_ && next_ < to) sampled(high_);
}

void UartDecoder::sampled(bool high) {
  if (bit_ == 0 && high) {  // a spike
    in_frame_ = false;
    return;
  }
  bits_ |= (high ? 1U : 0U) << bit_;
  ++bit_;
  next_ = bit_at(bit_ + 0.5);
  if (bit_ == 2 + line_.data_bits + parity_bits(line_)) finish();
}

// The first stop bit was looked at; the next byte may begin.
void UartDecoder::finish() {
  in_frame_ = false;
  frame_.end = bit_at(uart_bits(line_));
  const unsigned data = bits_ >> 1U & ((1U << line_.data_bits) - 1);
  frame_.byte = static_cast<Byte>(data);
  frame_.framing_error = (bits_ >> (bit_ - 1) & 1U) == 0;
  frame_.is_break = bits_ == 0;
  if (line_.parity != Parity::none)
    frame_.parity_error = ((bits_ >> (1 + line_.data_bits) & 1U) != 0) != parity_bit(data, line_.parity);
  take_(frame_);
}

}  // namespace porttape
