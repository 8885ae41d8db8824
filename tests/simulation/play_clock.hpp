#pragma once

#include <algorithm>
#include <cstdint>

#include "libport/base/time.hpp"

namespace porttape::simulation {

// The clock of a replayed tape as a user steers it: it stands while paused and else runs `rate` times as fast
// as the real one. Played time has no zero of its own: only differences count.
class PlayClock {
 public:
  explicit PlayClock(double rate = 1, bool paused = false)
      : rate_(rate), highest_rate_(rate), paused_(paused) {}

  [[nodiscard]] double rate() const { return rate_; }
  [[nodiscard]] double highest_rate() const { return highest_rate_; }  // so far
  [[nodiscard]] bool paused() const { return paused_; }
  // Played nanoseconds at `now`, which never goes back.
  [[nodiscard]] double at(Instant now) const {
    return played_ + (paused_ ? 0 : rate_ * static_cast<double>((now - since_).count()));
  }

  void pause(Instant now, bool on) {
    keep(now);
    paused_ = on;
  }
  void set_rate(Instant now, double rate) {
    keep(now);
    rate_ = rate;
    highest_rate_ = std::max(highest_rate_, rate);
  }
  // Something came by hand, that was due then.
  void move_to(double played) { played_ = std::max(played_, played); }

 private:
  void keep(Instant now) {
    played_ = at(now);
    since_ = now;
  }

  double rate_;
  double highest_rate_;
  bool paused_;
  Instant since_{};
  double played_ = 0;
};

}  // namespace porttape::simulation
