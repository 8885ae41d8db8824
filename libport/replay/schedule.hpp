#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "libport/base/bytes.hpp"
#include "libport/base/error.hpp"
#include "libport/replay/budget.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// The walk over the whole tape in merged order: the record it stands at, how much of a read is delivered, and
// what it has passed so far. Knows no time but the tape's.
//
// Refers to its source and its budget, which must outlive it; whoever walks in a loop asks spent(). After an
// error of the source the walk looks ended and error() is set.
class Schedule {
 public:
  struct Totals {
    std::uint64_t reads = 0;   // bytes
    std::uint64_t writes = 0;  // bytes
  };

  Schedule(RecordSource& source, Budget& budget) : source_(source), budget_(budget) {}

  void rewind();

  // The record the walk stands at; null at the tape's end. Its data stays valid until pop().
  [[nodiscard]] const Record* head();
  void pop();

  // A read at the head: what of it is still to be delivered.
  [[nodiscard]] ByteView rest();
  void take(std::size_t count) { taken_ += count; }

  // Over everything up to and including the write that holds the byte at `offset`, as far as the budget goes.
  void pass_write(std::uint64_t offset);

  // No more walking in this call.
  [[nodiscard]] bool spent() const { return budget_.spent(); }

  [[nodiscard]] bool at_end() { return head() == nullptr; }
  // Bytes of either direction in the records passed.
  [[nodiscard]] const Totals& passed() const { return passed_; }
  [[nodiscard]] std::uint64_t records_passed() const { return records_passed_; }
  // Writes, opens, closes, half-closes and hang-ups: what ends an arrival.
  [[nodiscard]] std::uint64_t breaks_passed() const { return breaks_passed_; }
  [[nodiscard]] std::uint64_t opens_passed() const { return opens_passed_; }
  [[nodiscard]] std::size_t hang_ups_passed() const { return hang_ups_passed_; }
  [[nodiscard]] std::size_t gaps_passed() const { return gaps_passed_; }
  // Whether the walk is between a recorded close and open: nobody had the line then.
  [[nodiscard]] bool line_closed() const { return line_closed_; }
  // 1-based number of the exchange that the byte at `offset` of the write stream belongs to. Exact for what
  // the walk has passed or stands at; further ahead it is taken to be the next one.
  [[nodiscard]] std::uint64_t exchange_of(std::uint64_t offset);
  [[nodiscard]] const std::optional<Error>& error() const { return error_; }

 private:
  RecordSource& source_;
  Budget& budget_;
  std::optional<Record> head_;
  bool loaded_ = false;
  std::size_t taken_ = 0;
  Totals passed_;
  std::uint64_t records_passed_ = 0;
  std::uint64_t breaks_passed_ = 0;
  std::uint64_t opens_passed_ = 0;
  std::size_t hang_ups_passed_ = 0;
  std::size_t gaps_passed_ = 0;
  std::uint64_t exchange_ = 0;
  bool answered_ = true;  // a read came after the last write
  bool line_closed_ = false;
  std::optional<Error> error_;
};

}  // namespace porttape
