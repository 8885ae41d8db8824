#pragma once

#include "libport/base/time.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// How far a session's handshake goes: up to the driver's first pause, a second in which it wrote nothing,
// though it had its answer. What the device says on its own meanwhile belongs to it. A plain value; tell it
// what the walk passes.
class Handshake {
 public:
  static constexpr Micros kPause{1'000'000};

  explicit Handshake(TapeTime begin) : asked_at_(begin) {}

  void passed(const Record& record) {
    if (record.data.empty()) return;
    if (record.kind == RecordKind::read) answered_ = true;
    if (record.kind != RecordKind::write) return;
    asked_at_ = record.at;
    answered_ = false;
  }
  // Before that.
  [[nodiscard]] bool over(const Record& next) const {
    const bool is_answer = next.kind == RecordKind::read && !next.data.empty() && !answered_;
    return !is_note(next.kind) && !is_answer && next.at - asked_at_ >= kPause;
  }

 private:
  TapeTime asked_at_;
  bool answered_ = true;
};

}  // namespace porttape
