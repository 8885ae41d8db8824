#include "libport/supervise/kept_calls.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <sys/syscall.h>

#include "libport/base/clock.hpp"

namespace porttape {
namespace {

// The calls that send a signal to one thread. That is their second argument, and the signal the third; of
// tkill() the first and the second.
constexpr std::array kSenders{SYS_tgkill, SYS_tkill, SYS_rt_tgsigqueueinfo};

// A thread that was sent a signal is looked at so often: the sender's own call comes after ours, and it may
// be scheduled late.
constexpr unsigned kLooksForSent = 20;
// Threads of one process that are asked in one look whether they take its signals.
constexpr int kAskedAtOnce = 8;

// The next one in turn, from the beginning again after the last. Not for an empty map.
template <class Map>
pid_t next_of(const Map& map, pid_t last) {
  const auto next = map.upper_bound(last);
  return next == map.end() ? map.begin()->first : next->first;
}

}  // namespace

// How long looks may go on. There is always time for one more of each kind.
class KeptCalls::Slice {
 public:
  explicit Slice(Nanos length) : end_(machine_clock().now() + length) {}
  [[nodiscard]] bool over() const { return machine_clock().now() >= end_; }

 private:
  Instant end_;
};

KeptCalls::KeptCalls(Loop& loop, Finish finish)
    : loop_(&loop),
      finish_(std::move(finish)),
      moment_timer_(loop, [this] { call_back_due(); }),
      look_timer_(
          loop, [this] { look(); }, Timer::By::machine) {}

KeptCalls::~KeptCalls() {
  for (const auto& [thread, kept] : by_thread_) kept.call->finish_ = {};
}

std::vector<CallTrap> KeptCalls::traps() {
  std::vector<CallTrap> traps;
  for (const long number : kSenders) traps.push_back({.number = static_cast<int>(number)});
  return traps;
}

// A thread's number in another PID namespace is another's here, or nobody's: it is found in its turn.
bool KeptCalls::sends(const Call& call) {
  if (std::ranges::find(kSenders, call.number()) == kSenders.end()) return false;
  const std::size_t target = call.number() == SYS_tkill ? 0 : 1;
  const auto to = static_cast<pid_t>(call.argument(target));
  const bool any_signal = static_cast<int>(call.argument(target + 1)) != 0;  // 0 only asks for the thread
  if (any_signal && by_thread_.contains(to)) sent_to_.insert_or_assign(to, kLooksForSent);
  return true;
}

std::shared_ptr<KeptCall> KeptCalls::add(const Call& call) {
  const pid_t thread = call.thread();
  gone(thread);  // one that had its number
  auto kept = std::make_shared<KeptCall>(call, loop_->clock());
  kept->finish_ = [this, call](Outcome outcome) {
    drop(call.thread());
    finish_(call, std::move(outcome));
  };
  kept->moment_ = [this, thread](Instant when) {
    Kept& waiting = by_thread_.at(thread);
    if (waiting.moment) moments_.erase({*waiting.moment, thread});
    waiting.moment = when;
    moments_.emplace(when, thread);
    schedule_moment();
  };
  by_thread_.emplace(thread, Kept{kept});
  fresh_.push_back(thread);
  if (!look_timer_.due()) look_timer_.set_after(kLook);
  return kept;
}

void KeptCalls::drop(pid_t thread) {
  const auto found = by_thread_.find(thread);
  if (found == by_thread_.end()) return;
  if (found->second.moment) {
    moments_.erase({*found->second.moment, thread});
    schedule_moment();
  }
  if (const auto process = processes_.find(found->second.process); process != processes_.end())
    leave(process, thread);
  by_thread_.erase(found);
}

void KeptCalls::leave(std::map<pid_t, Process>::iterator process, pid_t thread) {
  process->second.threads.erase(thread);
  process->second.unasked.erase(thread);
  if (process->second.threads.empty()) processes_.erase(process);
}

void KeptCalls::gone(pid_t thread) {
  const auto found = by_thread_.find(thread);
  if (found == by_thread_.end()) return;
  const std::shared_ptr<KeptCall> call = found->second.call;
  drop(thread);
  call->finish_ = {};
  if (const auto gone = std::exchange(call->on_gone_, {})) gone();
}

void KeptCalls::all_gone() {
  while (!by_thread_.empty()) gone(by_thread_.begin()->first);
}

void KeptCalls::interrupt(pid_t thread, int error) {
  const auto found = by_thread_.find(thread);
  if (found == by_thread_.end()) return;
  const std::shared_ptr<KeptCall> call = found->second.call;
  if (const auto gone = std::exchange(call->on_gone_, {})) gone();
  const bool always = call->restarts_always_ && error == KeptCall::kRestart;
  call->finish(outcome::Refuse{always ? KeptCall::kAlwaysRestart : error});
}

void KeptCalls::look() {
  const Slice slice(kSlice);
  look_in_turn(sent_to_, last_sent_to_, slice, [this](pid_t thread) {
    look_at_thread(thread);
    if (--sent_to_.at(thread) == 0 || !by_thread_.contains(thread)) sent_to_.erase(thread);
  });
  look_at_all(doubted_, slice, [this](pid_t thread) {
    if (still_waits(thread)) by_thread_.at(thread).doubted = false;
  });
  look_at_all(fresh_, slice, [this](pid_t thread) {
    const auto found = by_thread_.find(thread);
    if (found != by_thread_.end() && found->second.process == 0) look_at_thread(thread);
  });
  look_in_turn(processes_, last_process_, slice, [this](pid_t process) { look_at_process(process); });
  look_in_turn(by_thread_, last_thread_, slice, [this](pid_t thread) {
    if (hurried_ > 0) --hurried_;
    // A process's first one is looked at with its process.
    if (by_thread_.at(thread).process != thread) look_at_thread(thread);
  });
  if (by_thread_.empty()) return;
  const bool goes_on = hurried_ > 0 || !fresh_.empty() || !doubted_.empty();
  look_timer_.set_after(goes_on ? Nanos(0) : kLook);
}

template <class Look>
void KeptCalls::look_at_all(std::deque<pid_t>& threads, const Slice& slice, const Look& look) {
  while (!threads.empty()) {
    const pid_t thread = threads.front();
    threads.pop_front();
    look(thread);
    if (slice.over()) return;
  }
}

// Each once, if there is time.
template <class Map, class Look>
void KeptCalls::look_in_turn(const Map& map, pid_t& last, const Slice& slice, const Look& look) {
  for (std::size_t left = map.size(); left > 0 && !map.empty(); --left) {
    last = next_of(map, last);
    look(last);
    if (slice.over()) return;
  }
}

bool KeptCalls::still_waits(pid_t thread) {
  const auto found = by_thread_.find(thread);
  if (found == by_thread_.end()) return false;
  if (found->second.call->call().waits()) return true;
  gone(thread);
  return false;
}

void KeptCalls::look_at_thread(pid_t thread) {
  const auto found = by_thread_.find(thread);
  if (found == by_thread_.end()) return;
  const ThreadStatus status = thread_status(thread);
  if (!status.exists()) return (void)still_waits(thread);
  const pid_t before = std::exchange(found->second.process, status.process);
  if (before != status.process) {
    if (const auto process = processes_.find(before); process != processes_.end()) leave(process, thread);
    if (!still_waits(thread)) return;
    Process& process = processes_[status.process];
    process.threads.insert(thread);
    process.unasked.insert(thread);
  }
  if ((status.to_thread & ~status.blocked) != 0) return interrupt(thread, KeptCall::kRestart);
  look_for_tracer(thread, status);
}

// Most interrupt the thread then, which no pending signal shows; some do not (PTRACE_SEIZE alone), and 512
// would reach the program. A signal that does nothing makes it sure: the next look finds that.
void KeptCalls::look_for_tracer(pid_t thread, const ThreadStatus& status) {
  const auto found = by_thread_.find(thread);
  if (found == by_thread_.end()) return;
  Kept& kept = found->second;
  if (!kept.tracer || status.tracer == 0) kept.tracer = status.tracer;
  const bool anew = status.tracer != *kept.tracer;
  if (!anew) return;
  kept.tracer = status.tracer;
  send_what_does_nothing(thread, status);
}

// A signal for a whole process interrupts one of its threads: the kernel takes the first one, unless that
// blocks it or has ended, else one that is not to be known.
void KeptCalls::look_at_process(pid_t id) {
  Process& process = processes_.at(id);
  const ThreadStatus first = thread_status(id);
  if (first.threads < process.alive) doubt(process);
  const bool known = std::exchange(process.alive, first.threads) != 0;
  const std::uint64_t queued = std::exchange(process.queued, first.queued);
  if (known && first.queued > queued) hurried_ = by_thread_.size();
  if (first.state == 'T') {  // its threads are to stop with the one that has taken the signal for that
    for (const pid_t thread : std::set(process.threads)) interrupt(thread, KeptCall::kRestart);
    return;
  }
  const std::uint64_t taken = first.takes_signals() ? ~first.blocked : 0;
  const std::uint64_t left = first.to_process & ~taken;
  const Instant now = machine_clock().now();
  if ((left & ~process.left) != 0) {
    process.unasked = process.threads;
    process.left_since = now;
  }
  process.left = left;
  // A thread that runs, and can take them, has done so after a while.
  if (left != 0 && now - process.left_since >= kLook) give_to_another(id, left);
  if (((first.to_process | first.to_thread) & taken) != 0) return interrupt(id, KeptCall::kRestart);
  look_for_tracer(id, first);
}

// To one of those that wait. Only a thread that looks for signals may be told of one: 512 would reach the
// program else. Each is asked once, since none of them can change what it blocks meanwhile.
void KeptCalls::give_to_another(pid_t id, std::uint64_t signals) {
  Process& process = processes_.at(id);
  for (int asked = 0; asked < kAskedAtOnce && !process.unasked.empty(); ++asked) {
    const pid_t thread = *process.unasked.begin();
    process.unasked.erase(process.unasked.begin());
    if (thread == id || (thread_status(thread).blocked & signals) == signals) continue;
    process.left = 0;  // what is left then is looked at afresh
    return interrupt(thread, have_signals_looked_for(thread) ? KeptCall::kRestart : EINTR);
  }
}

// Some threads of the process have ended; which ones is asked later.
void KeptCalls::doubt(const Process& process) {
  for (const pid_t thread : process.threads) {
    if (!std::exchange(by_thread_.at(thread).doubted, true)) doubted_.push_back(thread);
  }
}

void KeptCalls::schedule_moment() {
  if (moments_.empty()) return moment_timer_.cancel();
  const Instant next = moments_.begin()->first;
  if (moment_timer_.due() != next) moment_timer_.set(next);
}

void KeptCalls::call_back_due() {
  const Instant now = loop_->now();
  while (!moments_.empty() && moments_.begin()->first <= now) {
    const pid_t thread = moments_.begin()->second;
    moments_.erase(moments_.begin());
    Kept& kept = by_thread_.at(thread);
    kept.moment.reset();
    const std::shared_ptr<KeptCall> call = kept.call;
    if (const auto callback = std::exchange(call->callback_, {})) callback();
  }
  schedule_moment();
}

}  // namespace porttape
