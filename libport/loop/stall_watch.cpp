#include "libport/loop/stall_watch.hpp"

#include <algorithm>

namespace porttape {

std::vector<Stall> StallWatch::since(Instant moment) const {
  std::vector<Stall> stalls;
  for (const Stall& stall : stalls_) {
    if (stall.begin + stall.length > moment) stalls.push_back(stall);
  }
  return stalls;
}

void StallWatch::note(Instant begin, Instant end) {
  if (!stalls_.empty() && begin <= stalls_.back().begin + stalls_.back().length) {
    Stall& last = stalls_.back();
    const Instant last_end = last.begin + last.length;
    last.begin = std::min(last.begin, begin);
    last.length = std::max(last_end, end) - last.begin;
    return;
  }
  if (stalls_.size() == kKept) stalls_.pop_front();
  stalls_.push_back({begin, end - begin});
  if (hook_) hook_(stalls_.back());
}

}  // namespace porttape
