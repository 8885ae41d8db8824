#pragma once

#include <cstdint>

#include "libport/base/time.hpp"
#include "libport/tape/record.hpp"

namespace porttape {

// A clock that is held, and the exchanges that are let through by hand meanwhile: each is what the device
// says up to the driver's next write, or a second of a device that goes on and on. A plain value.
class HandStep {
 public:
  static constexpr Micros kLongest{1'000'000};

  // Held: nothing comes but by hand. Not held: forgets what was asked for.
  void hold(bool held) {
    if (held) {
      held_ = true;
    } else {
      *this = {};
    }
  }
  void add(std::uint64_t exchanges) { left_ += exchanges; }

  // Nothing may come now.
  [[nodiscard]] bool stands() const { return held_ && left_ == 0; }
  // What comes now comes by hand.
  [[nodiscard]] bool under_way() const { return held_ && left_ > 0; }

  // The device has said what was recorded at `at`.
  void answered(TapeTime at) {
    if (!answering_) began_at_ = at;
    answering_ = true;
  }
  // The exchange that was answered ends before `next`: it is the driver's turn, the tape's end (null), or a
  // second is over.
  [[nodiscard]] bool over(const Record* next) const {
    if (!answering_ || next == nullptr) return answering_;
    if (is_note(next->kind) || (next->data.empty() && next->kind == RecordKind::write)) return false;
    const bool by_driver =
        next->kind == RecordKind::write || next->kind == RecordKind::open || next->kind == RecordKind::close;
    return by_driver || next->at - began_at_ >= kLongest;
  }
  // It ended: one less is to come.
  void end() {
    answering_ = false;
    if (left_ > 0) --left_;
  }

 private:
  bool held_ = false;
  std::uint64_t left_ = 0;
  bool answering_ = false;
  TapeTime began_at_{};
};

}  // namespace porttape
