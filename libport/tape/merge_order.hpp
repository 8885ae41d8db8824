#pragma once

#include <cstdint>

#include "libport/base/time.hpp"

namespace porttape {

enum class TapeFile : std::uint8_t { none, events, write, read };

// For a file that has come to its end.
constexpr TapeTime kNoMore = TapeTime::max();

// The order of a tape (FORMAT.md): which file goes on, by the time of what comes next in each; none where all
// three are at their end. Asked for each block: plain numbers, which an optional would double the time of.
constexpr TapeFile next_in_order(TapeTime event, TapeTime write, TapeTime read) {
  if (event <= write && event <= read) return event == kNoMore ? TapeFile::none : TapeFile::events;
  return write <= read ? TapeFile::write : TapeFile::read;
}

}  // namespace porttape
