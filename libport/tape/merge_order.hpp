#pragma once

#include <cstdint>
#include <optional>

#include "libport/base/time.hpp"

namespace porttape {

enum class TapeFile : std::uint8_t { events, write, read };

// The order of a tape (FORMAT.md): which file goes on, by the time of what comes next in each. A file that
// has come to its end has none; nothing where all three have.
constexpr std::optional<TapeFile> next_in_order(std::optional<TapeTime> event, std::optional<TapeTime> write,
                                                std::optional<TapeTime> read) {
  const auto not_after = [](TapeTime at, const std::optional<TapeTime>& other) {
    return !other || at <= *other;
  };
  if (event && not_after(*event, write) && not_after(*event, read)) return TapeFile::events;
  if (write && not_after(*write, read)) return TapeFile::write;
  if (read) return TapeFile::read;
  return std::nullopt;
}

}  // namespace porttape
