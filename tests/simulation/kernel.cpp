#include <algorithm>
#include <cstdlib>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include <boost/asio/detail/call_stack.hpp>
#include <boost/asio/detail/thread_context.hpp>
#include <boost/asio/detail/thread_info_base.hpp>

#include "tests/simulation/kernel_parts.hpp"

namespace porttape::simulation {
namespace {

// Asio knows by a thread_local variable which thread runs a loop, and wakes the loop for the others only. The
// threads here are one to the system, so each has that variable's value kept for it. Private names may be
// used where a template is instantiated.
using AsioThreads = boost::asio::detail::call_stack<boost::asio::detail::thread_context,
                                                    boost::asio::detail::thread_info_base>;
using AsioThread = boost::asio::detail::tss_ptr<AsioThreads::context>;
template <AsioThread* Variable>
struct Access {
  friend AsioThread& asio_thread() { return *Variable; }
};
AsioThread& asio_thread();
template struct Access<&AsioThreads::top_>;

using Moment = Kernel::Moment;
using std::chrono::microseconds;
using std::chrono::nanoseconds;
using std::chrono::seconds;

constexpr Moment kPoll = microseconds(5);  // what a poll takes
constexpr std::size_t kStack = std::size_t{256} << 10;

Kernel::Parts* the_kernel = nullptr;
Kernel* the_face = nullptr;
std::vector<void*> free_stacks;

void* take_stack() {
  if (!free_stacks.empty()) {
    void* const stack = free_stacks.back();
    free_stacks.pop_back();
    return stack;
  }
  void* const stack =
      ::mmap(nullptr, kStack, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  return stack == MAP_FAILED ? nullptr : stack;
}

void thread_main() {
  Thread& self = *the_kernel->running;
  self.result = self.start(self.argument);
  the_kernel->end_running();
}

}  // namespace

Kernel::Parts* Kernel::Parts::current() { return the_kernel; }

Thread& Kernel::Parts::start(void* (*function)(void*), void* argument) {
  threads.push_back(std::make_unique<Thread>());
  Thread& made = *threads.back();
  made.stack = take_stack();
  made.start = function;
  made.argument = argument;
  ::getcontext(&made.context);
  made.context.uc_stack = {made.stack, 0, kStack};
  made.context.uc_link = nullptr;
  ::makecontext(&made.context, thread_main, 0);
  return made;
}

void Kernel::Parts::end_running() {
  running->ended = true;
  for (const auto& each : threads) {
    if (each->thread == running) each->wake();
  }
  wait();  // for ever
  std::abort();
}

void Kernel::Parts::switch_to(Thread& next) {
  Thread* const last = std::exchange(running, &next);
  if (last != &next) {
    last->asio = static_cast<AsioThreads::context*>(asio_thread());
    asio_thread() = static_cast<AsioThreads::context*>(next.asio);
    ::swapcontext(&last->context, &next.context);
  }
  // Here again: those that have ended since leave their stacks.
  std::erase_if(threads, [this](const std::unique_ptr<Thread>& each) {
    if (!each->ended || !each->detached || each.get() == running) return false;
    free_stacks.push_back(each->stack);
    return true;
  });
}

Thread* Kernel::Parts::next_ready() {
  std::size_t ready = 0;
  for (const auto& each : threads) ready += !each->ended && !each->waits() ? 1U : 0U;
  if (ready == 0) return nullptr;
  std::uint64_t chosen = pick(ready);
  for (const auto& each : threads) {
    if (!each->ended && !each->waits() && chosen-- == 0) return each.get();
  }
  return nullptr;
}

// To the first moment that anybody waits for. False: there is none.
bool Kernel::Parts::advance() {
  std::optional<Moment> first;
  const auto consider = [&first](const std::optional<Moment>& due) {
    if (due && (!first || *due < *first)) first = due;
  };
  for (const auto& each : threads) {
    if (each->ended) continue;
    consider(each->deadline);
    if (!each->in_epoll) continue;
    for (const TimerFd& timer : timers) consider(timer.watched ? timer.due : std::nullopt);
  }
  if (!first) return false;
  time = std::max(time, *first);
  for (const auto& each : threads) {
    if (each->ended) continue;
    const bool timer_due = each->in_epoll && std::ranges::any_of(timers, [this](const TimerFd& timer) {
                             return timer.watched && timer.due && *timer.due <= time;
                           });
    if (timer_due || (each->deadline && *each->deadline <= time)) each->wake();
  }
  return true;
}

void Kernel::Parts::wait() {
  for (;;) {
    if (Thread* const next = next_ready()) {
      switch_to(*next);
      if (!running->waits()) return;
      continue;
    }
    // A worker may have posted to the loop: its descriptor shows that.
    const auto poller = std::ranges::find_if(threads, [](const auto& each) { return each->in_epoll; });
    if (poller != threads.end() && running != poller->get()) {
      (*poller)->in_epoll = false;
      (*poller)->deadline.reset();
      continue;
    }
    if (!advance()) {
      if (running == threads.front().get()) throw WaitsForEver{};
      threads.front()->wake();  // to tell it
      continue;
    }
  }
}

void Kernel::Parts::yield() {
  Thread* const next = next_ready();
  if (next != nullptr && next != running) switch_to(*next);
}

int Kernel::Parts::poll_now(int epoll_fd, epoll_event* events, int most) {
  long count = 0;
  if (may_have_events) count = ::syscall(SYS_epoll_pwait, epoll_fd, events, most, 0, nullptr, 8);
  if (count < 0) return -1;
  may_have_events = count > 0;
  for (const TimerFd& timer : timers) {
    if (count >= most || !timer.watched || !timer.due || *timer.due > time) continue;
    events[count].events = EPOLLIN;
    events[count++].data = timer.data;
  }
  return static_cast<int>(count);
}

int Kernel::Parts::epoll(int epoll_fd, epoll_event* events, int most, int timeout_ms) {
  tick(kPoll);
  const std::optional<Moment> limit =
      timeout_ms < 0 ? std::nullopt : std::optional(time + std::chrono::milliseconds(timeout_ms));
  for (;;) {
    const int count = poll_now(epoll_fd, events, most);
    if (count != 0 || timeout_ms == 0) {
      wake_ups += timeout_ms != 0 ? 1 : 0;
      return count;
    }
    if (limit && *limit <= time) return 0;
    running->in_epoll = true;
    running->deadline = limit;
    wait();
  }
}

Kernel::Kernel(std::uint64_t seed) : parts_(new Parts(seed)) {
  parts_->running = parts_->threads.front().get();
  the_kernel = parts_;
  the_face = this;
}

Kernel::~Kernel() {
  the_kernel = nullptr;
  the_face = nullptr;
  for (const auto& each : parts_->threads) {
    if (each->stack != nullptr && each->ended) free_stacks.push_back(each->stack);
  }
  delete parts_;
}

Kernel* Kernel::current() { return the_face; }
Moment Kernel::passed() const { return parts_->time; }
Instant Kernel::now() const {
  parts_->read_a_clock();
  return Instant(parts_->monotonic());
}
WallTime Kernel::wall() const {
  parts_->read_a_clock();
  return WallTime(parts_->wall());
}
std::uint64_t Kernel::wake_ups() const { return parts_->wake_ups; }
Random& Kernel::random() { return parts_->random; }
void Kernel::refuse_threads(bool refused) { parts_->threads_refused = refused; }
void Kernel::step_clock(Moment by) { parts_->wall_step += by; }

void Kernel::sleep(Moment time) {
  parts_->running->deadline = parts_->time + time;
  parts_->wait();
}

bool Kernel::on_worker() const { return parts_->running != parts_->threads.front().get(); }

bool Kernel::run_down() {
  const auto left = [this] {
    return std::ranges::any_of(parts_->threads, [this](const auto& each) {
      return each.get() != parts_->threads.front().get() && !each->ended;
    });
  };
  const Moment limit = parts_->time + seconds(3600);
  while (left()) {
    if (parts_->time > limit) return false;
    sleep(seconds(1));
  }
  return true;
}

}  // namespace porttape::simulation
