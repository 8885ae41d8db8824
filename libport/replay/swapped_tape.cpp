#include "libport/replay/swapped_tape.hpp"

#include <optional>

namespace porttape {
namespace {

std::optional<Side> other(std::optional<Side> side) {
  if (!side) return std::nullopt;
  return *side == Side::driver ? Side::device : Side::driver;
}

}  // namespace

Result<std::optional<Record>> SwappedTape::next() {
  Result<std::optional<Record>> next = source_.next();
  if (!next || !*next) return next;
  swap(**next);
  return next;
}

Result<void> SwappedTape::rewind() {
  closed_ = false;
  left_out_ = 0;
  return source_.rewind();
}

// What is left out comes as a note that has its bytes still, so that a Budget sees what reading over it
// costs.
void SwappedTape::swap(Record& record) {
  switch (record.kind) {
    case RecordKind::write:
      record.kind = select_ == Select::merged ? RecordKind::read : RecordKind::event;
      return;
    case RecordKind::read:
      record.kind = closed_ ? RecordKind::event : RecordKind::write;
      record.stream_offset -= left_out_;
      if (closed_) left_out_ += record.data.size();
      return;
    case RecordKind::open:
      closed_ = false;
      break;
    case RecordKind::close:
      closed_ = true;
      break;
    case RecordKind::half_close:
    case RecordKind::event:
      swap_event(record);
      break;
    case RecordKind::hang_up:
    case RecordKind::gap:
      break;
  }
}

void SwappedTape::swap_event(Record& record) {
  if (record.event == nullptr) return;
  if (const auto* half_close = std::get_if<event::HalfClose>(record.event)) {
    event_ = event::HalfClose{other(half_close->by)};
  } else if (const auto* settings = std::get_if<event::Settings>(record.event);
             settings != nullptr && settings->by != Side::driver) {
    event_ = event::Settings{std::nullopt, settings->line, settings->order};
  } else if (const auto taped = line_event_of(*record.event)) {
    const std::optional<Event> swapped = event_of({*other(taped->by), taped->what});
    if (!swapped) return;  // a flush, which has no side
    event_ = *swapped;
  } else {
    return;
  }
  record.event = &event_;
}

}  // namespace porttape
