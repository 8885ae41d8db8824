#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>

#include "libport/base/bytes.hpp"
#include "libport/base/error.hpp"
#include "libport/base/time.hpp"
#include "libport/line/line_signal.hpp"
#include "libport/replay/budget.hpp"
#include "libport/replay/output_flushes.hpp"
#include "libport/replay/settings_check.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// The walk over the whole tape in merged order: the record it stands at, how much of a read is delivered, and
// what it has passed so far. Knows no time but the tape's.
//
// Refers to its source, its budget and the check of settings, which is told all that it passes; they must
// outlive it. Whoever walks in a loop asks spent(). After an
// error of the source the walk looks ended and error() is set.
class Schedule {
 public:
  struct Totals {
    std::uint64_t reads = 0;   // bytes
    std::uint64_t writes = 0;  // bytes
  };

  Schedule(RecordSource& source, Budget& budget, SettingsCheck& settings)
      : source_(source), budget_(budget), settings_(settings) {}

  void rewind();
  // To the tape's beginning again in the same run: what was passed is not told again.
  void restart();
  // Whether anything recorded at `at` or later was passed, or a part of it.
  [[nodiscard]] bool passed(TapeTime at) const {
    return (records_passed_ > 0 || taken_ > 0) && latest_ >= at;
  }

  // The record the walk stands at; null at the tape's end. Its data stays valid until pop().
  [[nodiscard]] const Record* head();
  void pop();
  // As pop(), of what is left out: nobody is to make the settings there.
  void skip();
  // A read at the head: what of it is still to be delivered.
  [[nodiscard]] ByteView rest();
  void take(std::size_t count);
  // A part of a recorded read was taken or passed, and the rest was not.
  [[nodiscard]] bool inside_read() const {
    if (taken_ > 0) return true;
    return piece_passed_ && (!loaded_ || (head_ && head_->piece_offset > 0));
  }

  // Over everything up to and including the write that holds the byte at `offset`, as far as the budget goes.
  void pass_write(std::uint64_t offset);

  // No more walking in this call.
  [[nodiscard]] bool spent() const { return budget_.spent(); }

  [[nodiscard]] bool at_end() { return head() == nullptr; }
  // Bytes of either direction in the records passed.
  [[nodiscard]] const Totals& passed() const { return passed_; }
  // Bytes of reads passed, with those taken of the one at the head.
  [[nodiscard]] std::uint64_t reads_taken() const { return passed_.reads + taken_; }
  // When the latest of them was recorded.
  [[nodiscard]] TapeTime latest() const { return latest_; }
  // When the head was, if it is known already and there is one.
  [[nodiscard]] std::optional<TapeTime> known_head_at() const {
    return head_ && loaded_ ? std::optional(head_->at) : std::nullopt;
  }
  [[nodiscard]] std::uint64_t records_passed() const { return records_passed_; }
  // Writes, opens, closes, half-closes and hang-ups: what ends an arrival.
  [[nodiscard]] std::uint64_t breaks_passed() const { return breaks_passed_; }
  [[nodiscard]] std::uint64_t opens_passed() const { return opens_passed_; }
  [[nodiscard]] std::size_t hang_ups_passed() const { return hang_ups_passed_; }
  [[nodiscard]] std::size_t gaps_passed() const { return gaps_passed_; }
  // Of the tape's driver.
  [[nodiscard]] std::uint64_t output_flushes() const { return output_flushes_.count(); }
  // And how often what had come to it.
  [[nodiscard]] std::uint64_t input_flushes() const { return input_flushes_; }
  // Whether the walk is between a recorded close and open: nobody had the line then.
  [[nodiscard]] bool line_closed() const { return line_closed_; }
  // How the device's signals stand where the walk is, as far as the session before it tells.
  [[nodiscard]] const std::map<LineSignal::Name, LineSignal>& device_signals() const {
    return device_signals_;
  }
  // 1-based number of the exchange that the byte at `offset` of the write stream belongs to. Exact for what
  // the walk has passed or stands at; further ahead it is taken to be the next one.
  [[nodiscard]] std::uint64_t exchange_of(std::uint64_t offset);
  [[nodiscard]] const std::optional<Error>& error() const { return error_; }

 private:
  void pass(bool expected);
  void pass_event(const Event* event);

  RecordSource& source_;
  Budget& budget_;
  SettingsCheck& settings_;
  std::optional<Record> head_;
  bool loaded_ = false;
  std::size_t taken_ = 0;
  bool piece_passed_ = false;  // and it was not the last one of its read
  Totals passed_;
  TapeTime latest_{};
  std::uint64_t records_passed_ = 0;
  std::uint64_t records_told_ = 0;  // to settings_, in this run
  std::uint64_t breaks_passed_ = 0;
  std::uint64_t opens_passed_ = 0;
  std::size_t hang_ups_passed_ = 0;
  std::size_t gaps_passed_ = 0;
  OutputFlushes output_flushes_;  // in this run
  std::uint64_t input_flushes_ = 0;
  std::uint64_t exchange_ = 0;
  bool answered_ = true;  // a read came after the last write
  bool line_closed_ = false;
  std::map<LineSignal::Name, LineSignal> device_signals_;
  std::optional<Error> error_;
};

}  // namespace porttape
