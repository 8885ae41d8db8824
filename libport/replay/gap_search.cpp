#include "libport/replay/gap_search.hpp"

namespace porttape {

void GapSearch::begin(std::uint64_t swallowed) {
  const std::uint64_t left = active_ ? allowed_ - skipped_ : 0;
  *this = {};
  active_ = true;
  allowed_ = left + swallowed;
}

GapSearch::Found GapSearch::take(Byte byte, std::optional<Byte> front) {
  const std::optional<Byte> expected = at_front() ? front : std::optional(tape_[at_]);
  if (expected == byte) {
    const bool fresh = at_front();
    ++at_;
    if (!fresh) return Found::known;
    append(byte);
    return Found::front;
  }
  const std::size_t next = tape_.border(at_);
  skipped_ += at_ == 0 ? 1 : at_ - next;
  if (skipped_ > allowed_) {
    end();
    return Found::too_many;
  }
  if (at_ == 0) return Found::skipped;
  at_ = next;
  return Found::retry;
}

void GapSearch::append(Byte byte) {
  tape_.append(byte);
  const std::size_t size = tape_.size();
  if (size >= kMost || (size >= kSure && tape_.border(size) < size / 2)) end();
}

}  // namespace porttape
