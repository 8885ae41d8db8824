#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "libport/tape/difference_reader.hpp"

namespace porttape {

// Where the bytes of two turns differ first: in what was written, else in what was read.
struct ByteDifference {
  bool written = false;
  std::size_t offset = 0;  // in the turn; the end of the shorter one, where it is the other's beginning
};
std::optional<ByteDifference> first_difference(const Turn& one, const Turn& other);

// What one of the tapes has there, in a line.
struct DifferenceLine {
  bool of_other = false;      // of the second tape
  char what = 'w';            // w, r; e: an event, of which there is a text
  std::size_t offset = 0;     // of the bytes shown, in what was written or read
  ByteView bytes;             // of the turn
  bool cut = false;           // there are more behind them
  std::vector<bool> differs;  // which of them; empty: all, or none
  std::string text;           // safe to show
};
// At most `columns` are taken by the bytes of a line, as text and as hex.
std::vector<DifferenceLine> lines_of(const ShownDifference& difference, std::size_t columns);

// "exchange 17 at 12.345678 s".
std::string place_text(const Turn& turn);
// What is different, in words: "the answer from byte 4 on".
std::string headline_of(const ShownDifference& difference);

// "1 added, 2 changed"; empty: the tapes are the same.
std::string counts_text(const TapeDiff& diff);
// "117 of 120 exchanges and parts are the same; times count from 100 ms on".
std::string agreement_text(const TapeDiff& diff, std::optional<Micros> margin);
// "120 exchanges, 14 events".
std::string holdings_text(const ComparedTape& tape);

}  // namespace porttape
