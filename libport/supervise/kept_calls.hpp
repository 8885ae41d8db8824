#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <sys/types.h>
#include <utility>
#include <vector>

#include "libport/base/time.hpp"
#include "libport/loop/loop.hpp"
#include "libport/loop/timer.hpp"
#include "libport/supervise/call.hpp"
#include "libport/supervise/call_filter.hpp"
#include "libport/supervise/kept_call.hpp"
#include "libport/supervise/pending_signals.hpp"

namespace porttape {

// Holds the calls that a supervisor keeps. It ends a call whose thread has a signal, drops a call whose
// thread has ended, and calls a call back at the moment that it asked for.
//
// The kernel shows pending signals only in /proc. To read one thread's status takes some 20 µs, so the status
// of all threads cannot be read each millisecond. Each millisecond some 0.2 ms are spent on reading, in this
// order:
//
// 1. Threads that have just made their call, and threads to which a supervised thread sends a signal. The
//    calls that send a signal to one thread are trapped for this (traps()).
// 2. The first thread of each process, in turn. Its status shows the signals for the whole process, whether
//    the process is to stop, and whether some of its threads have ended.
// 3. The other threads, in turn. This finds signals that a timer, or a process outside, sends to one thread.
//
// A few calls are all looked at each millisecond. With 2000 threads of one process, the first two steps still
// are, and the third one takes a third of a second. When the number of signals that wait for the processes of
// a user has grown, the looks go on without a pause until each thread has been looked at once.
//
// A program that begins to trace a thread (strace -p, PTRACE_SEIZE) may interrupt it, which no pending signal
// shows. The thread's tracer is another one then, and the thread is sent a signal that does nothing, which
// its tracer sees, so that its call can be ended. What a tracer asks for later (an interrupt, so that strace
// can go) is not shown: it waits for the end of the call.
//
// Loop thread only.
class KeptCalls {
 public:
  using Finish = std::function<void(const Call& call, Outcome outcome)>;

  // How often looks are begun, by the machine's clock whatever the loop has, and how long they go on.
  static constexpr Nanos kLook = std::chrono::milliseconds(1);
  static constexpr Nanos kSlice = std::chrono::microseconds(200);

  // `loop` outlives it.
  KeptCalls(Loop& loop, Finish finish);
  ~KeptCalls();
  KeptCalls(const KeptCalls&) = delete;
  KeptCalls& operator=(const KeptCalls&) = delete;

  std::shared_ptr<KeptCall> add(const Call& call);
  // No thread waits any more.
  void all_gone();
  [[nodiscard]] std::size_t size() const { return by_thread_.size(); }

  // The calls by which a thread sends a signal to one thread.
  static std::vector<CallTrap> traps();
  // Returns whether `call` is one of these. The thread that it names is then looked at for a while; the
  // caller passes the call to the kernel.
  bool sends(const Call& call);

 private:
  struct Kept {
    std::shared_ptr<KeptCall> call;
    pid_t process = 0;  // 0: not looked at yet
    std::optional<Instant> moment = {};
    bool doubted = false;              // is in doubted_
    std::optional<pid_t> tracer = {};  // at the first look
  };
  // A process of which calls are kept.
  struct Process {
    std::set<pid_t> threads;  // that wait in them
    // At the last look: how many threads the process has, how many signals wait for its user's processes,
    // and which for this one that its first thread does not take.
    unsigned alive = 0;
    std::uint64_t queued = 0;
    std::uint64_t left = 0;
    Instant left_since{};     // of the machine's clock
    std::set<pid_t> unasked;  // of `threads`: whether it takes these
  };
  class Slice;

  void drop(pid_t thread);
  void leave(std::map<pid_t, Process>::iterator process, pid_t thread);
  void gone(pid_t thread);
  void interrupt(pid_t thread, int error);
  void look();
  template <class Map, class Look>
  static void look_in_turn(const Map& map, pid_t& last, const Slice& slice, const Look& look);
  template <class Look>
  static void look_at_all(std::deque<pid_t>& threads, const Slice& slice, const Look& look);
  bool still_waits(pid_t thread);
  void look_at_thread(pid_t thread);
  void look_at_process(pid_t id);
  void look_for_tracer(pid_t thread, const ThreadStatus& status);
  void doubt(const Process& process);
  void give_to_another(pid_t id, std::uint64_t signals);
  void schedule_moment();
  void call_back_due();

  Loop* loop_;
  Finish finish_;
  std::map<pid_t, Kept> by_thread_;  // a thread waits in one call
  std::map<pid_t, Process> processes_;
  std::set<std::pair<Instant, pid_t>> moments_;
  std::deque<pid_t> fresh_;            // threads that have just made their call
  std::deque<pid_t> doubted_;          // threads that may have ended
  std::map<pid_t, unsigned> sent_to_;  // threads that were sent a signal: how many looks are to follow
  // Which ones were looked at last in their turn.
  pid_t last_sent_to_ = 0;
  pid_t last_process_ = 0;
  pid_t last_thread_ = 0;
  std::size_t hurried_ = 0;  // looks that are to follow without a pause
  Timer moment_timer_;
  Timer look_timer_;
};

}  // namespace porttape
