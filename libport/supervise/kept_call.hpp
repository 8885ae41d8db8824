#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <utility>
#include <variant>

#include "libport/base/clock.hpp"
#include "libport/base/time.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/supervise/call.hpp"

namespace porttape {

// What becomes of a call.
namespace outcome {
struct Answer {  // it has been done: this is what it gives
  std::int64_t value = 0;
};
struct Refuse {  // this is its errno
  int error = 0;
};
struct Pass {};  // the kernel does it, as if nobody had looked
// A descriptor for this file is what it gives: the lowest that is free, as the kernel finds it, or `at`, in
// the place of what is there by then.
struct Install {
  UniqueFd file;
  std::optional<int> at = {};
  bool close_on_exec = false;
  std::function<void(int number)> given = {};  // called with the number that it has become
};
}  // namespace outcome
using Outcome = std::variant<outcome::Answer, outcome::Refuse, outcome::Pass, outcome::Install>;

// A call whose outcome comes later: its thread waits. A signal that comes to the thread ends it, as it would
// end the kernel's own. Made by Supervisor::keep(). Loop thread only.
class KeptCall {
 public:
  // What the kernel makes of an interrupted call (errno.h of the kernel's): done again where the handler has
  // SA_RESTART, else EINTR; and always EINTR.
  static constexpr int kRestart = 512;
  static constexpr int kNoHandlerRestart = 514;
  static constexpr int kAlwaysRestart = 513;  // with any handler

  // `clock` outlives it: the one of the supervisor's loop.
  KeptCall(const Call& call, const Clock& clock) : call_(call.for_later()), clock_(&clock) {}

  [[nodiscard]] const Call& call() const { return call_; }
  [[nodiscard]] bool over() const { return !finish_; }
  // Only the first counts.
  void finish(Outcome outcome);
  // Called where a signal or the thread's end came first; nothing is to be finished then.
  void on_gone(std::function<void()> callback) { on_gone_ = std::move(callback); }
  // What a signal makes of it, while nothing was done that would be done twice.
  void restarts_always(bool on) { restarts_always_ = on; }
  [[nodiscard]] Instant now() const { return clock_->now(); }
  // Calls back at that moment, unless it is over then. One at a time.
  void call_at(Instant when, std::function<void()> callback);
  void call_after(Nanos delay, std::function<void()> callback) {
    call_at(now() + delay, std::move(callback));
  }

 private:
  friend class KeptCalls;

  Call call_;
  const Clock* clock_;
  bool restarts_always_ = false;
  std::function<void(Outcome)> finish_;
  std::function<void()> on_gone_;
  std::function<void(Instant)> moment_;  // it is to be called back then
  std::function<void()> callback_;
};

}  // namespace porttape
