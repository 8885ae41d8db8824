#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"
#include "libport/replay/replies.hpp"

namespace porttape {

// What of a recorded write may vary, and how the answer follows it. Asked for each stretch of the tape and
// the bytes that came there; without one nothing may vary (`exactly`). A rule is a subclass of its own: no
// other part knows which one it is.
//
// How tape and driver are cut is chance: a stretch may end inside what the rule is about, and the driver's
// bytes may come one by one. So hold() is called again with what is left of each side. It keeps nothing of
// its own between calls: its answer depends only on its arguments. What it has to know of bytes that were
// used before is in the Memory, which its caller keeps, one for each comparison (see `Comparison`). A field
// that came longer is taken by using bytes that came and none of the tape's until its end shows; one that
// came shorter, by using the tape's and none that came. Behind a gap the place is found by equal bytes alone
// (GapSearch), whatever may vary.
//
// Where the latest bytes were taken so, and none of the tape's with them, the field is *open*. It may have no
// end but the write's own: when the driver then pauses (for `burst_gap`), writes no more or closes, hold() is
// called with no bytes, again while it uses the tape's, up to the block's end at most. A rule that waits for
// what the tape has behind the field uses nothing then: that is no difference, and its bytes may come later.
class Expectation {
 public:
  // Recorded bytes in a row, all of one block; never empty.
  struct Stretch {
    ByteView bytes;
    ByteView before;             // what the block has before them, as far as it is at hand
    std::uint64_t offset = 0;    // of the first of them in the tape's stream of writes
    std::uint32_t in_block = 0;  // of the first of them in its block
    bool ends_block = false;
    TapeTime at{};
    // What the tape has behind them, later blocks too: at least as much as reach() says, or up to where it
    // says.
    ByteView ahead{};
    bool ahead_ends = false;  // behind that is the stream's end or a pause of reach()
  };

  // How far a stretch has to look ahead.
  struct Reach {
    std::size_t bytes = 0;         // of the tape, from the stretch's first on
    Micros pause = Micros::max();  // no further than to the first one between two blocks that is so long
    friend bool operator==(const Reach&, const Reach&) = default;
  };

  // Whether what was recorded was left out, and the device's answer to it with it.
  enum class LeftOut : std::uint8_t { no, with_answer, alone, not_known };

  // How many bytes of each side are accepted and done with. `differs`: the next ones do not go together.
  // Where nothing is used they do not either, unless `goes_on`.
  struct Held {
    std::size_t recorded = 0;
    std::size_t came = 0;
    bool differs = false;
    // Uses more of the tape's, with what came before: to be asked again for what is left, also without bytes.
    bool goes_on = false;
    LeftOut left_out = LeftOut::no;  // the recorded bytes that are used, by the driver
    friend bool operator==(const Held&, const Held&) = default;
  };

  // What one comparison knows of the bytes that were used before; a new one at each place where comparing
  // begins. A value of bounded size: copied with the comparison. What is in it is hold()'s own but for
  // `ended` and `blame`.
  struct Memory {
    bool ended =
        false;  // the driver writes no more: set before hold() is asked for the last time, with no bytes
    // After `differs`: where the difference begins, so many bytes of each side before what was not used, and
    // what is wrong there, for a person; both sides' bytes are the ends of `recorded` and `came`.
    struct Blame {
      std::size_t recorded = 0;
      std::size_t came = 0;
      std::string why{};
      friend bool operator==(const Blame&, const Blame&) = default;
    };
    Blame blame{};

    Bytes frame{};         // the recorded one that the place is in, whole; empty: between two frames
    Bytes recorded{};      // what of it was used
    Bytes came{};          // what came for it, or for the next one, and was used
    bool settled = false;  // what came for it is as it may be: the rest of it is used without further bytes
    LeftOut left_out = LeftOut::no;  // the frame, if it is settled
    int format = -1;                 // which kind of frame it is; of the expectation's own
    bool sums_right = false;         // the tape's latest frame that may have a checksum has it right
    // Of each counter, in the expectation's order: what came and what was recorded last.
    struct Counted {
      bool any = false;
      std::uint64_t came = 0;
      std::uint64_t recorded = 0;
      friend bool operator==(const Counted&, const Counted&) = default;
    };
    std::vector<Counted> counted{};

    friend bool operator==(const Memory&, const Memory&) = default;
  };

  virtual ~Expectation() = default;

  // `came` is empty at a pause of the driver, after `goes_on`, and at its end.
  [[nodiscard]] virtual Held hold(const Stretch& recorded, ByteView came, Memory& memory) const = 0;

  // The same behind the tape's last write: what may come there all the same. With no bytes at the driver's
  // end.
  [[nodiscard]] virtual Held hold_beyond(ByteView, Memory&) const { return {.differs = true}; }

  [[nodiscard]] virtual Reach reach() const { return {}; }

  // What makes the answers follow, anew for each that plays the tape; null: they are played as recorded.
  [[nodiscard]] virtual std::unique_ptr<Replies> replies() const { return nullptr; }

  // Whether the driver may leave a frame out, whose answer does not come then.
  [[nodiscard]] virtual bool leaves_out() const { return false; }

  // Nothing may vary.
  [[nodiscard]] static Held exactly(ByteView recorded, ByteView came) {
    const ByteView shorter = recorded.first(std::min(recorded.size(), came.size()));
    const auto differing = std::mismatch(shorter.begin(), shorter.end(), came.begin()).first;
    const auto same = static_cast<std::size_t>(differing - shorter.begin());
    return {same, same, same < shorter.size()};
  }
};

// One comparison of what came with what was recorded: an expectation, or none, and what it remembers. A
// value: whoever tries several places on the tape copies it for each. Refers to the expectation, which must
// outlive it.
class Comparison {
 public:
  explicit Comparison(const Expectation* expectation = nullptr) : expectation_(expectation) {}

  [[nodiscard]] Expectation::Held hold(const Expectation::Stretch& recorded, ByteView came) {
    if (expectation_ == nullptr) return Expectation::exactly(recorded.bytes, came);
    Expectation::Held held = expectation_->hold(recorded, came, memory_);
    const bool nothing = held.recorded == 0 && held.came == 0 && !held.goes_on;
    held.differs = held.differs || (nothing && !came.empty());
    return held;
  }
  // hold() once the driver writes no more. `recorded` counts the bytes of the tape that need not have come.
  // `differs` says that the last bytes that came do not begin what was recorded.
  [[nodiscard]] Expectation::Held at_end(const Expectation::Stretch& recorded) {
    if (expectation_ == nullptr) return {};
    memory_.ended = true;
    return expectation_->hold(recorded, {}, memory_);
  }
  [[nodiscard]] Expectation::Held hold_beyond(ByteView came) {
    if (expectation_ == nullptr) return {.differs = true};
    memory_.ended = came.empty();
    return expectation_->hold_beyond(came, memory_);
  }
  // The comparison goes on elsewhere on the tape.
  void begin() { memory_ = {}; }
  // The driver's session is over: what comes next begins anew, and counters go on.
  void end_session() {
    Expectation::Memory next;
    next.counted = std::move(memory_.counted);
    memory_ = std::move(next);
  }

  [[nodiscard]] bool plain() const { return expectation_ == nullptr; }
  [[nodiscard]] const Expectation* expectation() const { return expectation_; }
  [[nodiscard]] const Expectation::Memory& memory() const { return memory_; }
  [[nodiscard]] Expectation::Reach reach() const {
    return expectation_ == nullptr ? Expectation::Reach{} : expectation_->reach();
  }

 private:
  const Expectation* expectation_;
  Expectation::Memory memory_{};
};

}  // namespace porttape
