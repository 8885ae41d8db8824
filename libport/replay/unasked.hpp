#pragma once

#include <optional>

#include "libport/tape/record.hpp"

namespace porttape {

// What of a tape nobody asked for: of each session what comes before its first write. The rest comes as notes
// that have their bytes still, so that a Budget sees what reading over them costs. Refers to its source.
class Unasked final : public RecordSource {
 public:
  explicit Unasked(RecordSource& source) : source_(source) {}

  Result<std::optional<Record>> next() override {
    Result<std::optional<Record>> next = source_.next();
    if (!next || !*next) return next;
    Record& record = **next;
    if (record.kind == RecordKind::open || record.kind == RecordKind::close) {
      asked_ = false;
      return next;
    }
    if (record.kind == RecordKind::write && !record.data.empty()) asked_ = true;
    if (record.kind == RecordKind::write || (asked_ && record.kind != RecordKind::gap) || by_driver(record)) {
      record.kind = RecordKind::event;
      record.event = nullptr;
    }
    return next;
  }
  Result<void> rewind() override {
    asked_ = false;
    return source_.rewind();
  }

 private:
  static bool by_driver(const Record& record) {
    const auto* half_close = record.event == nullptr ? nullptr : std::get_if<event::HalfClose>(record.event);
    return half_close != nullptr && half_close->by == Side::driver;
  }

  RecordSource& source_;
  bool asked_ = false;
};

// A tape with nothing on it.
class NoRecords final : public RecordSource {
 public:
  Result<std::optional<Record>> next() override { return std::optional<Record>{}; }
  Result<void> rewind() override { return {}; }
};

}  // namespace porttape
