#pragma once

#include <cstdint>
#include <deque>
#include <functional>

#include "libport/base/bytes.hpp"
#include "libport/base/result.hpp"
#include "libport/line/line_settings.hpp"

namespace porttape {

// The levels of several UART lines, sampled: a byte a sample, a bit a line, high without a byte. Lines are
// driven at times that may lie a little before what was driven last, until advance() has written them.
// Memory: a chunk, and what is driven and not written.
class UartWaveform {
 public:
  static constexpr std::size_t kChunk = std::size_t{4} << 20U;  // as sigrok has them
  static constexpr std::size_t kMostFrames = std::size_t{4} << 20U;
  using Write = std::function<Result<void>(ByteView chunk)>;

  UartWaveform(unsigned lines, Write write);

  struct Format {
    LineSettings line;
    double samples_per_bit = 8;
  };
  // A byte, at a time or when the line is free. False: more bytes wait than can be.
  bool byte(unsigned line, std::uint64_t at, Byte byte, const Format& format);
  // Low from `at`, or when the line is free, to `end`.
  void low(unsigned line, std::uint64_t at, std::uint64_t end);

  // When all that the line was given is over.
  [[nodiscard]] std::uint64_t free_at(unsigned line) const { return lines_.at(line).free; }

  // Nothing before `to` is driven from here on.
  Result<void> advance(std::uint64_t to);
  // The last samples.
  Result<void> finish(std::uint64_t end);

 private:
  struct Frame {
    std::uint64_t begin = 0;
    std::uint64_t end = 0;
    double samples_per_bit = 0;
    std::uint32_t word = 0;  // bits, the first in the lowest place
    unsigned bits = 0;
  };
  struct Line {
    std::deque<Frame> frames;
    std::uint64_t free = 0;
  };
  Result<void> chunk(std::size_t size);
  void draw(const Frame& frame, Byte mask);

  Write write_;
  std::deque<Line> lines_;
  Byte high_ = 0;
  Bytes chunk_;
  std::uint64_t begin_ = 0;  // of the chunk
};

}  // namespace porttape
