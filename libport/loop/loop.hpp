#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "libport/base/bytes.hpp"
#include "libport/base/clock.hpp"
#include "libport/base/time.hpp"
#include "libport/base/workers.hpp"
#include "libport/loop/fence.hpp"
#include "libport/loop/patience.hpp"
#include "libport/loop/stall_watch.hpp"

namespace boost::asio {
class io_context;
}

namespace porttape {

class FileEvents;
class Sampler;
class TimerQueue;
class UrgentEvents;

// The event loop that ports live on: one thread, the one that calls run(), or one at a time where each turns
// it by run_one() and poll_one() under a lock (BlockingPort). Owns the io_context; outlives every port on it.
//
// Time on a loop is that of the clock which it was given: what its ports stamp, what timers wait for, and
// what they compare. Only what is about the machine itself goes by the machine's clock in any case: how long
// the loop polls before it sleeps, and timers that ask for it (Timer::By::machine).
class Loop {
 public:
  Loop() : Loop(machine_clock()) {}
  // `clock` outlives the loop. One that does not pass by itself is moved between two calls of run_one() or
  // poll_one(), or from a callback, and clock_moved() is called each time.
  explicit Loop(const Clock& clock) : Loop(clock, machine_clock()) {}
  // For a machine that is simulated as well.
  Loop(const Clock& clock, const Clock& machine);
  ~Loop();
  Loop(const Loop&) = delete;
  Loop& operator=(const Loop&) = delete;

  // Runs until stop() or until nothing is left to wait for. While events follow each other within
  // microseconds (a request, its answer, the next request) it polls for a moment before it sleeps: waking a
  // thread takes longer than such a wait.
  void run();
  // Waits for one event and handles it. False when there is nothing to wait for.
  bool run_one();
  // Handles one event if one is ready. False when none was.
  bool poll_one();
  void stop();
  void restart();

  // Calls `task` from run(), never from within post().
  void post(std::function<void()> task);

  // Runs `job` on another thread, then `done` on the loop's, from run(); a loop that ends before it does not
  // wait for it and drops `done`. Jobs of one strand run in turn. False when no thread is to be had: nothing
  // was taken. Only values that the job owns may be touched by it.
  [[nodiscard]] bool run_elsewhere(const Workers::Strand& strand, std::function<void()> job,
                                   std::function<void()> done);
  Workers& workers() { return workers_; }
  // A post() for other threads, which may be called when the loop has gone: nothing happens then. Does not
  // keep run() waiting.
  [[nodiscard]] std::function<void(std::function<void()>)> poster();

  // Calls `work`; an exception out of it goes to the fence. What it makes (timers, watches, tasks, and in
  // turn what those make) stays behind the same fence. Without one, exceptions leave run().
  void within(const std::shared_ptr<Fence>& fence, const std::function<void()>& work);
  [[nodiscard]] const std::shared_ptr<Fence>& fence() const { return fence_; }

  // Room for one read, shared by all ports of the loop. What is in it counts until the next port reads.
  std::span<Byte> read_buffer();

  // What all ports of the loop share; made when first asked for.
  FileEvents& file_events();
  Sampler& sampler();
  UrgentEvents& urgent_events();

  // The latest stalls of run(): a handler that took longer than StallWatch::kShortest, a timer that came so
  // late. Those that ended after `moment`, oldest first.
  [[nodiscard]] std::vector<Stall> stalls_since(Instant moment) const { return stalls_.since(moment); }
  // Called once a stall, for the log.
  void on_stall(std::function<void(const Stall&)> hook) { stalls_.on_stall(std::move(hook)); }

  // For watches: the event that is being handled is this descriptor's.
  void came_from(int fd) { patience_.came_from(fd); }
  // For timers: one of that queue, which was expected then, comes now.
  void timer_comes(const TimerQueue& timers, Instant expected);
  TimerQueue& timers() { return *timers_; }
  TimerQueue& machine_timers() { return machine_timers_ ? *machine_timers_ : *timers_; }

  // Waiting actively for a moment that is near keeps the loop's thread from everything else: when it did so
  // last, for all ports together.
  [[nodiscard]] Instant last_spin() const { return last_spin_; }
  void spun_until(Instant moment) { last_spin_ = moment; }

  boost::asio::io_context& io() { return *io_; }

  [[nodiscard]] const Clock& clock() const { return *clock_; }
  [[nodiscard]] Instant now() const { return clock_->now(); }
  // The first moment that a timer waits for by the loop's clock; nullopt if none does.
  [[nodiscard]] std::optional<Instant> next_timer() const;
  // True while jobs of run_elsewhere() are under way. What they gave comes with a later turn.
  [[nodiscard]] bool has_jobs() const;
  // After a clock that does not pass by itself was moved: what is due now comes in the next turns.
  void clock_moved();

 private:
  struct Gate;

  bool poll_from(Instant start);
  void handled(Instant end);
  std::function<void()> fenced(std::function<void()> task);

  static constexpr std::size_t kReadBuffer = 65536;  // the largest datagram fits, and the largest tape block

  const Clock* clock_;
  const Clock* machine_;
  std::unique_ptr<boost::asio::io_context> io_;
  std::unique_ptr<TimerQueue> timers_;
  std::unique_ptr<TimerQueue> machine_timers_;  // nullptr where the loop has the machine's clock
  std::unique_ptr<Byte[]> read_buffer_;         // made when first asked for
  Patience patience_;
  Instant last_spin_{};
  StallWatch stalls_;
  Instant handler_began_ = Instant::max();  // of the handler that runs, once it is known, while run() does
  Instant running_since_ = Instant::max();
  std::shared_ptr<Fence> fence_;  // of what runs now
  std::shared_ptr<Gate> gate_;
  std::unique_ptr<FileEvents> file_events_;
  std::unique_ptr<Sampler> sampler_;
  std::unique_ptr<UrgentEvents> urgent_events_;
  Workers workers_;
};

}  // namespace porttape
