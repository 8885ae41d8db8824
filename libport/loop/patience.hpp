#pragma once

#include <array>
#include <chrono>
#include <cstddef>

#include "libport/base/time.hpp"

namespace porttape {

// Guesses whether a loop's next event comes sooner than a sleeping thread is woken, so that polling for it
// pays: yes while the last waits were all short and the events came from few descriptors (a request and its
// answer; with many lines the next event is no answer, and nobody waits for it); no for a while after a poll
// found other programs on the processor, where polling would only use up the share that a quick answer needs
// later; and while polls mostly end without an event, as those do for events that come just later than a poll
// lasts.
class Patience {
 public:
  // A wait that counts as short, with the wake-up and the work after it.
  static constexpr Nanos kShortWait = std::chrono::microseconds(100);
  static constexpr int kShortWaitsInARow = 16;
  // Between two looks of one poll this long: the processor was given to another program for a whole turn.
  static constexpr Nanos kPreempted = std::chrono::milliseconds(1);
  static constexpr Nanos kFirstRest = std::chrono::seconds(1);  // doubles each time
  static constexpr Nanos kLongestRest = std::chrono::seconds(60);

  // The descriptors that make a conversation: two lines.
  static constexpr std::size_t kFewSources = 4;

  // So many polls are judged together: when fewer than half of them met an event, none for a while. The while
  // doubles each time, and begins anew when polls pay again.
  static constexpr int kPollsJudged = 16;
  static constexpr Nanos kFirstPause = std::chrono::milliseconds(20);
  static constexpr Nanos kLongestPause = std::chrono::seconds(2);

  // The loop slept, and has handled what woke it: `time` in all.
  void waited(Nanos time);
  // The event that is being handled came from this descriptor.
  void came_from(int source);
  // The loop looked for events at these times and found none.
  void polled(Instant last, Instant now);
  // A poll is over; whether it met an event.
  void poll_ended(bool met, Instant now);
  [[nodiscard]] bool expects_soon(Instant now) const;

 private:
  int short_waits_ = 0;  // in a row
  std::array<int, kFewSources> sources_ = {-1, -1, -1, -1};
  std::size_t oldest_source_ = 0;
  Instant rests_until_{};
  Nanos rest_ = kFirstRest;
  int polls_ = 0;
  int polls_met_ = 0;
  Instant pauses_until_{};
  Nanos pause_ = kFirstPause;
};

}  // namespace porttape
