#include "libport/formats/uart_listener.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace porttape {
namespace {

constexpr std::size_t kMostOfBurst = 4096;

}  // namespace

UartListener::UartListener(ImportTape& to, std::uint64_t samples_per_second, const LineSettings& line,
                           std::uint64_t zero)
    : to_(to), rate_(samples_per_second), zero_(zero) {
  const double of_bit = static_cast<double>(rate_) / line.baud;
  pause_ = static_cast<std::uint64_t>(std::llround(2 * uart_bits(line) * of_bit));
  lines_.reserve(2);  // decoders refer to their line
  for (const Direction way : {Direction::read, Direction::write}) {
    const std::size_t index = lines_.size();
    lines_.push_back(
        {way,
         UartDecoder(of_bit, line, [this, index](const auto& frame) { take(lines_[index], frame); }),
         {}});
  }
}

TapeTime UartListener::time(std::uint64_t sample) const {
  const std::uint64_t since = sample - std::min(sample, zero_);
  return tape_time_us(
      static_cast<std::int64_t>(since / rate_ * 1'000'000 + since % rate_ * 1'000'000 / rate_));
}

Result<void> UartListener::level(Direction way, std::uint64_t at, bool high) {
  Result<void> advanced = advance(at);
  Line& line = of(way);
  line.decoder.level(at, high);
  if (line.broken && high) tell(line, at, false);
  return advanced;
}

Result<void> UartListener::advance(std::uint64_t to) {
  std::uint64_t settled = to;
  for (Line& line : lines_) {
    line.decoder.advance(to);
    if (!line.block.empty() && line.decoder.idle() && to > line.end + pause_) close(line);
    // A block that goes on gets a time that is not before these.
    if (!line.block.empty()) settled = std::min(settled, line.way == Direction::read ? line.end : line.begin);
  }
  const std::uint64_t frame = pause_;
  return give(settled - std::min(settled, frame));
}

void UartListener::take(Line& line, const UartDecoder::Frame& frame) {
  if (!line.block.empty() && (frame.begin > line.end + pause_ || line.block.size() == kMostOfBurst))
    close(line);
  if (frame.is_break) {
    if (!line.broken) tell(line, frame.begin, true);
    return;
  }
  if ((frame.framing_error || frame.parity_error) && errors_++ == 0)
    to_.problem(fmt::format("bytes with a {} error, first at {} µs: another speed, or another format?",
                            frame.framing_error ? "framing" : "parity", to_us(time(frame.begin))));
  if (line.block.empty()) line.begin = frame.begin;
  line.block.push_back(frame.byte);
  line.end = frame.end;
}

void UartListener::close(Line& line) {
  ready_.emplace(line.way == Direction::read ? line.end : line.begin,
                 Ready{line.way, std::exchange(line.block, {}), std::nullopt});
}

void UartListener::tell(Line& line, std::uint64_t at, bool on) {
  if (!line.block.empty()) close(line);
  line.broken = on;
  const Side by = line.way == Direction::read ? Side::device : Side::driver;
  ready_.emplace(at, Ready{line.way, {}, event::Break{on, by}});
}

Result<void> UartListener::give(std::uint64_t settled) {
  while (!ready_.empty() && ready_.begin()->first <= settled) {
    const auto [at, ready] = std::move(*ready_.begin());
    ready_.erase(ready_.begin());
    Result<void> put =
        ready.event ? to_.event(time(at), *ready.event) : to_.block(ready.way, time(at), ready.block);
    if (!put) return put;
  }
  return {};
}

Result<void> UartListener::finish(std::uint64_t end) {
  if (Result<void> advanced = advance(end + pause_); !advanced) return advanced;
  for (Line& line : lines_) {
    if (!line.block.empty()) close(line);
  }
  return give(~std::uint64_t{0});
}

}  // namespace porttape
