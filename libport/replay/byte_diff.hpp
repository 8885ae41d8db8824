#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "libport/base/bytes.hpp"

namespace porttape {

// How one run of bytes became another: the fewest bytes left out, added and changed. Plain values.
struct ByteEdit {
  std::optional<Byte> recorded;  // nothing: the byte was added
  std::optional<Byte> came;      // nothing: it was left out

  [[nodiscard]] bool same() const { return recorded == came; }
  friend bool operator==(const ByteEdit&, const ByteEdit&) = default;
};

// `open_end`: more of what came may have followed, so that what is missing at its end is not left out and
// does not stand in the result. Looks at the first kMostDiffed bytes of each; time and memory grow with their
// product.
constexpr std::size_t kMostDiffed = 512;
std::vector<ByteEdit> diff_bytes(ByteView recorded, ByteView came, bool open_end = false);

// How many of them are not the same.
std::size_t differing(const std::vector<ByteEdit>& edits);

}  // namespace porttape
