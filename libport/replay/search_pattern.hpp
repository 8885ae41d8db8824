#pragma once

#include <cstddef>
#include <vector>

#include "libport/base/bytes.hpp"

namespace porttape {

// A pattern that grows, and what of it still fits a text when its next byte does not: the search of Knuth,
// Morris and Pratt. A value.
class SearchPattern {
 public:
  void append(Byte byte) {
    const std::size_t border = bytes_.empty() ? 0 : matched_after(borders_.back(), byte);
    bytes_.push_back(byte);
    borders_.push_back(border);
  }

  [[nodiscard]] std::size_t size() const { return bytes_.size(); }
  [[nodiscard]] Byte operator[](std::size_t at) const { return bytes_[at]; }
  // The longest beginning of the first `matched` bytes that is their end too, and shorter.
  [[nodiscard]] std::size_t border(std::size_t matched) const {
    return matched == 0 ? 0 : borders_[matched - 1];
  }
  // How many bytes of the pattern the text's end is after `byte`, when it was `matched` before.
  [[nodiscard]] std::size_t matched_after(std::size_t matched, Byte byte) const {
    if (matched == size()) matched = border(matched);
    while (matched > 0 && bytes_[matched] != byte) matched = border(matched);
    return !bytes_.empty() && bytes_[matched] == byte ? matched + 1 : 0;
  }

 private:
  Bytes bytes_;
  std::vector<std::size_t> borders_;  // of each beginning
};

}  // namespace porttape
