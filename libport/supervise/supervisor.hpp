#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <optional>
#include <set>
#include <sys/types.h>
#include <utility>
#include <variant>
#include <vector>

#include "libport/base/clock.hpp"
#include "libport/base/time.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/loop/fd_watch.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/timer.hpp"
#include "libport/supervise/call.hpp"
#include "libport/supervise/call_filter.hpp"
#include "libport/supervise/known_threads.hpp"

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
// A descriptor for this file is what it gives: at `at`, or the lowest that is free.
struct Install {
  UniqueFd file;
  std::optional<int> at = {};
  bool close_on_exec = false;
};
}  // namespace outcome
using Outcome = std::variant<outcome::Answer, outcome::Refuse, outcome::Pass, outcome::Install>;

// A call whose outcome comes later: its thread waits. A signal that comes to the thread ends it, as it would
// end the kernel's own.
class KeptCall {
 public:
  // What the kernel makes of an interrupted call (errno.h of the kernel's): done again where the handler has
  // SA_RESTART, else EINTR; and always EINTR.
  static constexpr int kRestart = 512;
  static constexpr int kNoHandlerRestart = 514;

  // `clock` outlives it: the one of the supervisor's loop.
  KeptCall(const Call& call, const Clock& clock) : call_(call.for_later()), clock_(&clock) {}

  [[nodiscard]] const Call& call() const { return call_; }
  [[nodiscard]] bool over() const { return !finish_; }
  // Only the first counts.
  void finish(Outcome outcome);
  // Called where a signal or the thread's end came first; nothing is to be finished then.
  void on_gone(std::function<void()> callback) { on_gone_ = std::move(callback); }
  [[nodiscard]] Instant now() const { return clock_->now(); }
  // Calls back at that moment, unless it is over then. One at a time.
  void call_at(Instant when, std::function<void()> callback);
  void call_after(Nanos delay, std::function<void()> callback) {
    call_at(now() + delay, std::move(callback));
  }

 private:
  friend class Supervisor;

  Call call_;
  const Clock* clock_;
  std::function<void(Outcome)> finish_;
  std::function<void()> reschedule_;
  std::function<void()> on_gone_;
  std::optional<Instant> at_;
  std::function<void()> at_callback_;
  bool seen_before_ = false;  // a signal for the process, at the last look
  unsigned looks_ = 0;
};

class Supervisor;

// One thing that the supervisor does with calls. The parts are asked in turn.
class CallPart {
 public:
  virtual ~CallPart() = default;
  [[nodiscard]] virtual std::vector<CallTrap> traps() const = 0;

  struct NotMine {};
  struct Kept {};  // keep() of the supervisor was called for it
  using Decision = std::variant<NotMine, Kept, Outcome>;
  virtual Decision decide(Supervisor& supervisor, const Call& call) = 0;
};

// Answers the trapped calls of the programs behind one listener (trap_calls()), on a loop. What no part wants
// is passed. Owns the listener; destroyed before the programs have ended, their trapped calls fail with
// ENOSYS, so that they are to be ended first. Loop thread only.
class Supervisor {
 public:
  // Kept calls are called back by the clock of the loop.
  Supervisor(Loop& loop, UniqueFd listener, std::vector<std::unique_ptr<CallPart>> parts);
  ~Supervisor();
  Supervisor(const Supervisor&) = delete;
  Supervisor& operator=(const Supervisor&) = delete;

  // For a part, within decide().
  std::shared_ptr<KeptCall> keep(const Call& call);
  // The same for a call that gives EINTR after a signal whatever the handler has, as the kernel's waits for
  // what is to be sent do.
  std::shared_ptr<KeptCall> keep_until_signal(const Call& call);

  // How often a kept call's thread is looked at for signals, by the machine's clock whatever the loop has,
  // and each how many times for its process' stop.
  static constexpr Nanos kSignalLook = std::chrono::milliseconds(1);
  static constexpr unsigned kStopLook = 16;

 private:
  // Whom we answer mostly runs at once, in our place, and has made its next call when we go on: taken without
  // a turn of the loop. So many, some 100 µs, before the loop's other events have theirs.
  static constexpr int kInARow = 8;

  void on_readable();
  void all_gone();
  void take_one();
  void handle(const Call& call);
  std::optional<Outcome> install_file(std::uint64_t id, const outcome::Install& install);
  void send(const Call& call, Outcome outcome);
  void call_back_due();
  void look();
  static int interruption_of(KeptCall& kept, std::set<pid_t>& told);
  void look_at_signals();
  void forget_gone();
  void schedule();

  UniqueFd listener_;
  std::vector<std::unique_ptr<CallPart>> parts_;
  Loop* loop_;
  bool calls_stay_;
  KnownThreads threads_;
  std::vector<std::byte> told_;  // room for a notification of this kernel
  std::vector<std::byte> response_;
  std::list<std::shared_ptr<KeptCall>> kept_;
  FdWatch watch_;
  Timer call_timer_;  // for kept calls that are to be called back
  Timer look_timer_;  // while there are kept calls
};

}  // namespace porttape
