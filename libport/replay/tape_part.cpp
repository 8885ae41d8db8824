#include "libport/replay/tape_part.hpp"

namespace porttape {

void SessionSearch::on_open(TapeTime at) {
  if (opens_ == part_.session && !closed_) part_.to = at;
  ++opens_;
  if (opens_ == part_.session) part_.from = at;
}

void SessionSearch::on_close(TapeTime at) {
  if (opens_ != part_.session || closed_) return;
  closed_ = true;
  part_.to = at;
}

std::optional<TapePart> SessionSearch::found() const {
  if (part_.session == 0 || (part_.session == 1 && opens_ == 0)) return TapePart{};
  return part_.session <= opens_ ? std::optional(part_) : std::nullopt;
}

Result<std::optional<Record>> PartOfTape::next() {
  if (over_) return std::optional<Record>{};
  Result<std::optional<Record>> next = source_.next();
  if (!next || !*next) return next;
  Record& record = **next;
  const bool is_read = record.kind == RecordKind::read;
  const bool is_write = record.kind == RecordKind::write;
  switch (place_of(record)) {
    case Place::before:
      if (is_read) reads_before_ += record.data.size();
      if (is_write) writes_before_ += record.data.size();
      record.kind = RecordKind::event;
      record.event = nullptr;
      record.at = {};
      return next;
    case Place::behind:
      over_ = true;
      return std::optional<Record>{};
    case Place::inside:
      break;
  }
  record.at = part_.shifted(record.at);
  if (is_read) record.stream_offset -= reads_before_;
  if (is_write) record.stream_offset -= writes_before_;
  return next;
}

Result<void> PartOfTape::rewind() {
  opens_ = reads_before_ = writes_before_ = 0;
  closed_ = over_ = false;
  return source_.rewind();
}

// Blocks by their time, since one direction alone has no events; events by their order, since several may
// have one time.
PartOfTape::Place PartOfTape::place_of(const Record& record) {
  if (part_.whole()) return Place::inside;
  if (record.at >= part_.from && part_.shifted(record.at) >= part_.until) return Place::behind;
  if (record.kind != RecordKind::read && record.kind != RecordKind::write) return place_of_event(record.kind);
  return record.at < part_.from ? Place::before : record.at < part_.to ? Place::inside : Place::behind;
}

PartOfTape::Place PartOfTape::place_of_event(RecordKind kind) {
  if (part_.session == 0) return Place::inside;
  if (kind == RecordKind::open) ++opens_;
  if (opens_ < part_.session) return Place::before;
  if (opens_ > part_.session || closed_) return Place::behind;
  closed_ = kind == RecordKind::close;
  return Place::inside;
}

}  // namespace porttape
