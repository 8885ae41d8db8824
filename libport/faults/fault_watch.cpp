#include "libport/faults/fault_watch.hpp"

#include <algorithm>

namespace porttape {
namespace {

constexpr std::uint64_t kMostKept = 16;  // of a truncated frame, where that is drawn

// splitmix64: every bit of the number hangs on every bit of x.
std::uint64_t mixed(std::uint64_t x) {
  x += 0x9E3779B97F4A7C15U;
  x = (x ^ (x >> 30U)) * 0xBF58476D1CE4E5B9U;
  x = (x ^ (x >> 27U)) * 0x94D049BB133111EBU;
  return x ^ (x >> 31U);
}

}  // namespace

FaultWatch::FaultWatch(const Fault& fault, std::size_t index, std::uint64_t seed, LineDir dir, bool datagrams)
    : fault_(&fault),
      base_(mixed(mixed(seed) + 2 * index + (dir == LineDir::w ? 1 : 0))),
      datagrams_(datagrams),
      by_frames_(fault.unit == Fault::Unit::frame || (fault.unit == Fault::Unit::automatic && datagrams)),
      framed_(by_frames_ || fault.when == Fault::When::frame) {}

std::uint64_t FaultWatch::drawn(std::uint64_t position) const { return mixed(mixed(base_ + position)); }

bool FaultWatch::is_drawn(std::uint64_t number) const {
  return static_cast<double>(mixed(base_ + number) >> 11U) * 0x1p-53 < fault_->chance;
}

// Without a look at the single bytes.
bool FaultWatch::passes_over(std::size_t bytes) const {
  if (left_ > 0) return false;
  if (fault_->times > 0 && strikes_ >= fault_->times) return true;
  switch (fault_->when) {
    case Fault::When::chance:
      return fault_->chance <= 0;
    case Fault::When::byte:
      return fault_->position < position_ || (!framed_ && fault_->position >= position_ + bytes);
    case Fault::When::time:
      return timed_out_;
    case Fault::When::frame:
      return frame_ > fault_->position;
  }
  return false;
}

void FaultWatch::look(ByteView arrival, Nanos elapsed, std::vector<Hit>& hits) {
  if (passes_over(arrival.size())) {
    position_ += arrival.size();
    return;
  }
  if (datagrams_) at_start_ = true;
  for (std::size_t at = 0; at < arrival.size(); ++at) {
    if (framed_ && at_start_) begin_frame();
    const bool frame_ends = framed_ && (datagrams_ ? at + 1 == arrival.size() : ends_frame(arrival[at]));
    if (left_ == 0 && strikes(elapsed)) {
      left_ = fault_->burst;
      nth_ = 0;
      ++strikes_;
    }
    if (left_ > 0) {
      if (!by_frames_ || frame_ends) --left_;
      hits.push_back({at, nth_++, left_ == 0});
    }
    at_start_ = frame_ends;
    ++in_frame_;
    ++position_;
  }
}

bool FaultWatch::strikes(Nanos elapsed) {
  if (fault_->times > 0 && strikes_ >= fault_->times) return false;
  switch (fault_->when) {
    case Fault::When::byte:
      return position_ == fault_->position;
    case Fault::When::time: {
      const bool now = !timed_out_ && elapsed >= fault_->at;
      timed_out_ = timed_out_ || now;
      return now;
    }
    case Fault::When::chance:
      if (!by_frames_) return is_drawn(position_);
      break;
    case Fault::When::frame:
      break;
  }
  return armed_ && in_frame_ == strikes_at_;
}

void FaultWatch::begin_frame() {
  ++frame_;
  in_frame_ = 0;
  armed_ = fault_->when == Fault::When::frame ? frame_ == fault_->position
                                              : fault_->when == Fault::When::chance && is_drawn(frame_);
  strikes_at_ = 0;
  if (fault_->kind == Fault::Kind::truncate) strikes_at_ = fault_->keep.value_or(drawn(frame_) % kMostKept);
}

// The end of a frame may come in pieces, and begin within itself (0d 0d 0a).
bool FaultWatch::ends_frame(Byte byte) {
  if (fault_->frame_size > 0) return in_frame_ + 1 >= fault_->frame_size;
  const Bytes& end = fault_->frame_end;
  while (matched_ > 0 && end[matched_] != byte) {
    // The longest beginning of `end` that what was matched ends with.
    std::size_t shorter = matched_ - 1;
    const auto fits = [&](std::size_t length) {
      return std::equal(end.begin(), end.begin() + static_cast<std::ptrdiff_t>(length),
                        end.begin() + static_cast<std::ptrdiff_t>(matched_ - length));
    };
    while (shorter > 0 && !fits(shorter)) --shorter;
    matched_ = shorter;
  }
  if (end[matched_] == byte) ++matched_;
  if (matched_ < end.size()) return false;
  matched_ = 0;
  return true;
}

}  // namespace porttape
