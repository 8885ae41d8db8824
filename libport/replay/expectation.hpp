#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "libport/base/bytes.hpp"
#include "libport/base/time.hpp"

namespace porttape {

// What of a recorded write may vary. The matcher asks it for each stretch of the tape and the bytes that came
// there; without one nothing may vary (`exactly`). A rule is a subclass of its own: no other part knows which
// one it is.
//
// How tape and driver are cut is chance: a stretch may end inside what the rule is about, and the driver's
// bytes may come one by one. So hold() is called again with what is left of each side. It keeps nothing
// between calls: its answer depends only on the place on the tape and the bytes given. A field that came
// longer is taken by using bytes that came and none of the tape's until its end shows; one that came shorter,
// by using the tape's and none that came. Behind a gap the place is found by equal bytes alone (GapSearch),
// whatever may vary.
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
  };

  // How many bytes of each side are accepted and done with. `differs`: the next ones do not go together.
  // Where nothing is used they do not either.
  struct Held {
    std::size_t recorded = 0;
    std::size_t came = 0;
    bool differs = false;
    friend bool operator==(const Held&, const Held&) = default;
  };

  virtual ~Expectation() = default;

  // `came` is empty at a pause of the driver alone.
  [[nodiscard]] virtual Held hold(const Stretch& recorded, ByteView came) const = 0;

  // Nothing may vary.
  [[nodiscard]] static Held exactly(ByteView recorded, ByteView came) {
    const ByteView shorter = recorded.first(std::min(recorded.size(), came.size()));
    const auto differing = std::mismatch(shorter.begin(), shorter.end(), came.begin()).first;
    const auto same = static_cast<std::size_t>(differing - shorter.begin());
    return {same, same, same < shorter.size()};
  }
};

}  // namespace porttape
