#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <utility>

#include "libport/base/bytes.hpp"
#include "libport/tape/exchange_count.hpp"
#include "libport/tape/part_writer.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// One thing that was said: what is compared with another tape.
struct Turn {
  enum class Kind : std::uint8_t {
    exchange,  // a run of writes and what was read up to the next one; its beginning, where it is long
    part,      // more of a long one
    unasked,   // what was read behind an open or a close, or before the first write
    event      // all but those that tell of the tape itself: end, zero
  };
  Kind kind = Kind::event;
  std::uint32_t exchange = 0;  // its number as porttape info counts them; unasked, events: of the one before
  std::uint32_t part = 0;      // 0: the first
  TapeTime at{};               // of its first block
  TapeTime until{};            // of its last one
  Micros wait{};               // from the last block before, or the open, to its first one
  std::optional<Micros> answer;  // from its last write to the first read
  Bytes writes;
  Bytes reads;
  Event event{};
  std::string line;  // of the event, as it is on the tape

  [[nodiscard]] bool is_event() const { return kind == Kind::event; }
};

// Reads a tape turn by turn. Long runs of one direction are cut where their bytes say so (behind lines, else
// by a rolling hash), so that equal data is cut alike wherever it stands; the longer a run, the longer its
// parts, up to 4 MiB. An event comes behind the turn it fell into. Memory: a turn and 1024 events. Refers to
// the source.
class TurnReader {
 public:
  static constexpr std::size_t kLongRun = 4096;  // a run up to here is not cut

  struct Options {
    bool events = true;  // whether it gives them
    TapeProgress progress{};
  };

  explicit TurnReader(RecordSource& source) : TurnReader(source, Options{}) {}
  TurnReader(RecordSource& source, Options options) : source_(source), options_(std::move(options)) {}

  // Null: the tape has no more. Valid until the next call. Errors as of the source.
  Result<const Turn*> next();
  // How many turns next() has given.
  [[nodiscard]] std::uint64_t count() const { return count_; }
  // Exchanges so far.
  [[nodiscard]] std::uint64_t exchanges() const { return exchanges_.count(); }

 private:
  void take(const Record& record);
  void take_data(const Record& record, bool writes);
  void take_event(const Record& record);
  void begin(Turn::Kind kind, TapeTime at);
  void append(ByteView data, TapeTime at, bool writes);
  bool ends_here(Byte byte, std::size_t size);
  void finish();

  RecordSource& source_;
  Options options_;
  std::uint64_t bytes_ = 0;
  std::uint64_t count_ = 0;
  bool ended_ = false;
  std::deque<Turn> ready_;
  Turn given_;

  ExchangeCount exchanges_;
  std::optional<Turn> turn_;
  std::deque<Turn> events_;  // of that turn
  std::uint32_t part_ = 0;   // of an exchange that goes on behind turn_: the next one's number
  std::uint64_t run_ = 0;    // bytes of the same direction so far
  bool writing_ = false;
  std::uint64_t rolling_ = 0;
  TapeTime asked_{};  // the last write
  TapeTime last_{};   // the last block or open
};

}  // namespace porttape
