#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "libport/formats/import_tape.hpp"
#include "libport/formats/uart_decoder.hpp"

namespace porttape {

// Two lines with UARTs, as a tape: bytes that follow each other closely are a block; what was read has the
// time of its end, what was written that of its begin. Levels come in the order of their times.
class UartListener {
 public:
  // `zero`: the sample that is the tape's zero.
  UartListener(ImportTape& to, std::uint64_t samples_per_second, const LineSettings& line,
               std::uint64_t zero);

  UartListener(const UartListener&) = delete;
  UartListener& operator=(const UartListener&) = delete;

  Result<void> level(Direction way, std::uint64_t at, bool high);
  // Nothing has changed before `to`.
  Result<void> advance(std::uint64_t to);
  Result<void> finish(std::uint64_t end);
  [[nodiscard]] TapeTime time(std::uint64_t sample) const;

 private:
  struct Line {
    Direction way = Direction::read;
    UartDecoder decoder;
    Bytes block;
    std::uint64_t begin = 0;
    std::uint64_t end = 0;
    bool broken = false;
  };
  struct Ready {
    Direction way = Direction::read;
    Bytes block;
    std::optional<Event> event;
  };
  void take(Line& line, const UartDecoder::Frame& frame);
  void close(Line& line);
  void tell(Line& line, std::uint64_t at, bool on);
  // What nothing can come before any more.
  Result<void> give(std::uint64_t settled);
  Line& of(Direction way) { return lines_[way == Direction::read ? 0 : 1]; }

  ImportTape& to_;
  std::uint64_t rate_;
  std::uint64_t zero_;
  std::uint64_t pause_;  // ends a block
  std::vector<Line> lines_;
  std::multimap<std::uint64_t, Ready> ready_;
  std::uint64_t errors_ = 0;
};

}  // namespace porttape
