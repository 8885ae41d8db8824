#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>

#include "libport/base/time.hpp"

namespace porttape {

// How long somebody waits for peers that have something left to read: while it is seen to become less, and at
// most `limit` without that. Where nobody knows how much is left, `limit` in all.
class EndWait {
 public:
  EndWait(Instant now, Nanos limit) : since_(now), limit_(limit) {}

  // What is left now, nothing where that is not known. False: it has been waited long enough.
  bool goes_on(Instant now, std::optional<std::size_t> left) {
    if (left && least_ && *left < *least_) since_ = now;
    if (left) least_ = std::min(*left, least_.value_or(*left));
    return now - since_ < limit_;
  }
  // The peers are given `bytes` more, since they took what they had: that is progress.
  void more_given(Instant now, std::size_t bytes) {
    since_ = now;
    if (least_) *least_ += bytes;
  }

 private:
  Instant since_;  // the last progress
  Nanos limit_;
  std::optional<std::size_t> least_;
};

}  // namespace porttape
