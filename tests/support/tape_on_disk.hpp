#pragma once

#include <stdexcept>
#include <string>
#include <vector>

#include "libport/tape/new_tape.hpp"
#include "tests/support/memory_tape.hpp"
#include "tests/support/tape_bytes.hpp"

namespace porttape::test {

inline Result<void> put(NewTape& tape, const MemoryTape::Entry& entry) {
  const TapeTime at = tape_time_us(entry.us);
  switch (entry.kind) {
    case RecordKind::read:
      return tape.block(Direction::read, at, as_bytes(entry.data));
    case RecordKind::write:
      return tape.block(Direction::write, at, as_bytes(entry.data));
    case RecordKind::open:
      return tape.event(at, event::Open{});
    case RecordKind::close:
      return tape.event(at, event::Close{});
    case RecordKind::hang_up:
      return tape.event(at, event::DeviceLost{.why = "unplugged", .hung_up = true});
    default:
      return tape.event(at, entry.event);
  }
}

// Writes it as files, with an `end`.
inline TapePaths write_tape(const TapePaths& paths, const MemoryTape& tape, const TapeHeader& header = {}) {
  auto made = NewTape::create(paths, header, {.sync = false});
  if (!made) throw std::runtime_error(made.error().message);
  for (const auto& entry : tape.entries()) {
    if (const auto done = put(*made, entry); !done) throw std::runtime_error(done.error().message);
  }
  if (const auto done = made->finish(made->latest()); !done) throw std::runtime_error(done.error().message);
  return paths;
}

// Its records in order, one line each, events whole; `end` and what is carried are left out.
inline std::vector<std::string> lines_on(const TapePaths& paths) {
  auto reader = TapeReader::open(paths);
  if (!reader) return {"error: " + reader.error().message};
  std::vector<std::string> lines;
  for (;;) {
    const auto next = reader->next();
    if (!next) lines.push_back("error: " + next.error().message);
    if (!next || !*next) return lines;
    const Record& record = **next;
    const bool of_tape = record.event != nullptr &&
                         (std::holds_alternative<event::End>(*record.event) || is_carried(record.event_line));
    if (of_tape) continue;
    lines.push_back(record.event == nullptr ? describe(record) : std::string(record.event_line));
  }
}

// What is carried onto it.
inline std::vector<std::string> carried_on(const TapePaths& paths) {
  auto reader = TapeReader::open(paths, TapeReader::Select::events_only);
  std::vector<std::string> lines;
  while (reader) {
    const auto next = reader->next();
    if (!next || !*next) break;
    if (is_carried((**next).event_line)) lines.push_back(describe(**next));
  }
  return lines;
}

}  // namespace porttape::test
