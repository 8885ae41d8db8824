#pragma once

#include <chrono>
#include <cstddef>
#include <optional>

#include "libport/base/end_wait.hpp"
#include "libport/base/time.hpp"

namespace porttape {

// How long the steps of a session's end may take.
struct EndLimits {
  Nanos without_progress = std::chrono::seconds(5);      // sending and leaving together, see EndWait
  Nanos completing = std::chrono::milliseconds(10'500);  // a port gives a disk 10 s, and tells its loss
  Nanos failed_step = std::chrono::milliseconds(900);    // each of these two, of a failed end
  Nanos at_once = std::chrono::milliseconds(500);        // completing, after a second stop
};

// Where a session stands on its way to the end, and how long it may stand there. It only decides; what a step
// does is the session's. No clock, no port.
//
// | step       | what happens                                             | leads on                     |
// |------------|----------------------------------------------------------|------------------------------|
// | running    | bytes go both ways                                       | begin()                      |
// | collecting | what has come in by now is passed on                     | send(): that was all         |
// | sending    | only the rest of a driver that has closed is taken in;   | leave(): it has gone out     |
// |            | what was taken in goes out                               |                              |
// | leaving    | the driver's line is hung up once it has read everything | complete(): it is gone       |
// | completing | both ports are closed; tape and report are completed     | end(): they are, or given up |
// | ended      | the exit status is told                                  |                              |
//
// complete() may come in any step before: it gives up what they have left.
class SessionEnd {
 public:
  enum class Step { running, collecting, sending, leaving, completing, ended };
  enum class Stop { begin, wait, give_up };

  explicit SessionEnd(EndLimits limits) : limits_(limits) {}

  [[nodiscard]] Step step() const { return step_; }
  [[nodiscard]] bool running() const { return step_ == Step::running; }
  // Whether bytes that come in are passed on.
  [[nodiscard]] bool takes_in() const { return step_ <= Step::collecting; }

  // Somebody wants the end: says what is to be done about it. The first one waits for an end under way.
  Stop stop();
  // A port asks for an end that is known to have failed, and must not take long.
  void fail() { pace_ = Pace::failed; }

  // The steps. False: it was taken before.
  bool begin() { return go_on(Step::collecting); }
  bool send(Instant now);
  bool leave() { return go_on(Step::leaving); }
  bool complete() { return go_on(Step::completing); }
  bool end() { return go_on(Step::ended); }

  // Sending and leaving: `left` bytes are still to be read by the peers, nothing where that is not known.
  // False: it has been waited long enough.
  bool waits_on(Instant now, std::optional<std::size_t> left);
  // Sending: `bytes` more are taken in from a driver that has closed, and passed on.
  void took_rest(Instant now, std::size_t bytes) {
    if (wait_ && pace_ == Pace::patient) wait_->more_given(now, bytes);
  }
  // How long completing may take.
  [[nodiscard]] Nanos completing_limit() const;

 private:
  enum class Pace {
    patient,  // while there is progress
    failed    // a limit in all, whatever is read meanwhile
  };

  bool go_on(Step next);

  EndLimits limits_;
  Step step_ = Step::running;
  Pace pace_ = Pace::patient;
  int stops_ = 0;  // at most two: a third is no news
  std::optional<EndWait> wait_;
};

}  // namespace porttape
