#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "libport/base/bytes.hpp"
#include "libport/replay/search_pattern.hpp"

namespace porttape {

// Finds where the tape goes on behind a gap. The driver writes what the gap swallowed, which the tape does
// not have, and then what the tape has from the gap on; both may begin alike, and polls repeat. So its bytes
// are taken as the end of an unknown text that the tape's bytes follow (a SearchPattern of them, as they are
// matched), as long as the unknown part is no longer than what the gap swallowed.
//
// Settled, so that checking is as strict as before, once the place is sure: enough bytes in a row that do not
// repeat themselves, or very many. A value.
class GapSearch {
 public:
  static constexpr std::size_t kSure = 64;
  static constexpr std::size_t kMost = 4096;

  // `swallowed`: bytes of the gap.
  void begin(std::uint64_t swallowed);
  void end() { *this = {}; }

  [[nodiscard]] bool active() const { return active_; }
  // The driver's latest bytes are not the tape's.
  [[nodiscard]] bool astray() const { return active_ && skipped_ > 0 && (at_ == 0 || at_ < tape_.size()); }
  // Every byte of the tape that was read since the gap is matched: the next one is needed.
  [[nodiscard]] bool at_front() const { return at_ == tape_.size(); }

  // The driver's next byte; `front`: the tape's next one, where there is one and at_front().
  enum class Found : std::uint8_t {
    front,    // it is the tape's next byte: consume that
    known,    // it goes with bytes of the tape that were consumed before
    skipped,  // it is the gap's
    retry,    // with what the driver wrote before it, it may go elsewhere: call again
    too_many  // the gap did not swallow so much; the search is over
  };
  Found take(Byte byte, std::optional<Byte> front);

 private:
  void append(Byte byte);

  bool active_ = false;
  std::uint64_t allowed_ = 0;
  std::uint64_t skipped_ = 0;
  std::size_t at_ = 0;  // bytes of tape_ that the driver's latest ones are
  SearchPattern tape_;  // what was matched since the gap
};

}  // namespace porttape
