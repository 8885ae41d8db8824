#include "libport/formats/uart_waveform.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "libport/formats/uart_decoder.hpp"

namespace porttape {

UartWaveform::UartWaveform(unsigned lines, Write write)
    : write_(std::move(write)), lines_(lines), high_(static_cast<Byte>((1U << lines) - 1)) {}

bool UartWaveform::byte(unsigned line, std::uint64_t at, Byte byte, const Format& format) {
  Line& of = lines_.at(line);
  if (of.frames.size() == kMostFrames) return false;
  Frame frame;
  frame.begin = std::max({at, of.free, begin_});
  frame.bits = uart_bits(format.line);
  frame.word = uart_word(byte, format.line);
  frame.samples_per_bit = format.samples_per_bit;
  frame.end = frame.begin + static_cast<std::uint64_t>(std::llround(frame.bits * frame.samples_per_bit));
  of.free = frame.end;
  of.frames.push_back(frame);
  return true;
}

void UartWaveform::low(unsigned line, std::uint64_t at, std::uint64_t end) {
  Line& of = lines_.at(line);
  Frame frame;
  frame.begin = std::max({at, of.free, begin_});
  if (frame.begin >= end || of.frames.size() == kMostFrames) return;
  frame.end = end;
  frame.bits = 1;
  frame.samples_per_bit = static_cast<double>(end - frame.begin);
  of.free = end + 1;
  of.frames.push_back(frame);
}

Result<void> UartWaveform::advance(std::uint64_t to) {
  while (begin_ + kChunk <= to) {
    if (Result<void> written = chunk(kChunk); !written) return written;
  }
  return {};
}

Result<void> UartWaveform::finish(std::uint64_t end) {
  for (const Line& line : lines_) end = std::max(end, line.free);
  if (Result<void> advanced = advance(end); !advanced) return advanced;
  return end == begin_ ? Result<void>() : chunk(end - begin_);
}

Result<void> UartWaveform::chunk(std::size_t size) {
  chunk_.assign(size, high_);
  const std::uint64_t end = begin_ + size;
  Byte mask = 1;
  for (Line& line : lines_) {
    for (const Frame& frame : line.frames) {
      if (frame.begin >= end) break;
      draw(frame, mask);
    }
    while (!line.frames.empty() && line.frames.front().end <= end) line.frames.pop_front();
    mask = static_cast<Byte>(mask << 1U);
  }
  begin_ = end;
  return write_(chunk_);
}

void UartWaveform::draw(const Frame& frame, Byte mask) {
  const std::uint64_t chunk_end = begin_ + chunk_.size();
  const auto edge = [&](unsigned bit) {
    return frame.begin + static_cast<std::uint64_t>(std::llround(bit * frame.samples_per_bit));
  };
  for (unsigned bit = 0; bit < frame.bits; ++bit) {
    if ((frame.word >> bit & 1U) != 0) continue;
    const std::uint64_t from = std::max(edge(bit), begin_);
    const std::uint64_t to = std::min(edge(bit + 1), chunk_end);
    for (std::uint64_t at = from; at < to; ++at)
      chunk_[at - begin_] = static_cast<Byte>(chunk_[at - begin_] & ~mask);
  }
}

}  // namespace porttape
