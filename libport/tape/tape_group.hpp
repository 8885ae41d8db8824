#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "libport/tape/tape_reader.hpp"

namespace porttape {

// One of several tapes that are read together, in the order of time.
struct GroupedTape {
  TapePaths paths;
  std::optional<TapeHeader> header;  // with the zero, wherever that stands
  Micros at{};                       // its zero on the group's time, which begins with the earliest one's
};

// Reads their headers. Errors as TapeReader; Errc::usage: a tape is given twice, or a copy of it.
Result<std::vector<GroupedTape>> grouped_tapes(const std::vector<TapePaths>& tapes);

// How much later than the first each began: by the clock of the boot in which all were recorded, or as parts
// of one tape (porttape split). Nothing: they do not tell.
std::optional<std::vector<Micros>> begins_by_clock(std::span<const GroupedTape> tapes);
std::optional<std::vector<Micros>> begins_by_parts(std::span<const GroupedTape> tapes);

// Sets GroupedTape::at by when each begins, on any common time.
void place_tapes(std::span<GroupedTape> tapes, std::span<const Micros> begins);

// A tape of a group with its next record in view.
class GroupInput {
 public:
  GroupInput(TapeReader reader, Micros later) : reader_(std::move(reader)), later_(later) {}

  // To the first or the next record. After an error it is over.
  Result<void> advance();

  [[nodiscard]] bool over() const { return !record_; }
  [[nodiscard]] const Record& record() const { return *record_; }  // at its own time
  [[nodiscard]] TapeTime at() const { return record_->at + later_; }
  [[nodiscard]] Micros later() const { return later_; }
  [[nodiscard]] TapeTime last() const { return last_; }  // of what it had so far
  [[nodiscard]] bool lacks_end() const { return reader_.has_events() && !ended_; }
  [[nodiscard]] const TapeReader& reader() const { return reader_; }
  // Whether its record comes before the other one's, in the order of FORMAT.md.
  [[nodiscard]] bool before(const GroupInput& other) const;

 private:
  TapeReader reader_;
  Micros later_;
  std::optional<Record> record_;
  TapeTime last_{};
  bool ended_ = false;
};

// The one whose record comes next, of equal ones the first; null: all are over. Of a block in several pieces
// all are to be taken before another is asked for.
GroupInput* earliest_of(std::span<const std::unique_ptr<GroupInput>> inputs);

}  // namespace porttape
