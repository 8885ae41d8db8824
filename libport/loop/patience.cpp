#include "libport/loop/patience.hpp"

#include <algorithm>

namespace porttape {

void Patience::waited(Nanos time) {
  short_waits_ = time <= kShortWait ? std::min(short_waits_ + 1, kShortWaitsInARow) : 0;
}

void Patience::came_from(int source) {
  if (std::ranges::find(sources_, source) != sources_.end()) return;
  sources_[oldest_source_] = source;
  oldest_source_ = (oldest_source_ + 1) % kFewSources;
  short_waits_ = 0;
}

void Patience::polled(Instant last, Instant now) {
  if (now - last < kPreempted) return;
  rests_until_ = now + rest_;
  rest_ = std::min(rest_ * 2, kLongestRest);
  short_waits_ = 0;
}

void Patience::poll_ended(bool met, Instant now) {
  if (met) ++polls_met_;
  if (++polls_ < kPollsJudged) return;
  if (polls_met_ * 2 >= kPollsJudged) {
    pause_ = kFirstPause;
  } else {
    pauses_until_ = now + pause_;
    pause_ = std::min(pause_ * 2, kLongestPause);
  }
  polls_ = polls_met_ = 0;
}

bool Patience::expects_soon(Instant now) const {
  return short_waits_ == kShortWaitsInARow && now >= rests_until_ && now >= pauses_until_;
}

}  // namespace porttape
