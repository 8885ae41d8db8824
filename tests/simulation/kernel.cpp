#include "tests/simulation/kernel.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <deque>
#include <dlfcn.h>
#include <functional>
#include <memory>
#include <optional>
#include <pthread.h>
#include <sched.h>
#include <sys/epoll.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/timerfd.h>
#include <time.h>
#include <ucontext.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include <boost/asio/detail/call_stack.hpp>
#include <boost/asio/detail/thread_context.hpp>
#include <boost/asio/detail/thread_info_base.hpp>

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

// What reading the clock and a poll cost; a program that polls until a moment would never get there else.
constexpr Moment kTick = nanoseconds(40);
constexpr Moment kPoll = microseconds(5);
constexpr Moment kYield = microseconds(2);
// The monotonic clock at a seed's start, and the wall clock's.
constexpr Moment kBoot = seconds(1000);
constexpr Moment kWall = seconds(1'700'000'000);
// How often a thread that reads the clock or takes a lock lets others go first, one time in so many.
constexpr std::uint64_t kTurns = 16;
constexpr std::size_t kStack = std::size_t{256} << 10;

template <class Function>
Function real(const char* name) {
  return reinterpret_cast<Function>(::dlsym(RTLD_NEXT, name));
}

Moment moment(const timespec& time) { return seconds(time.tv_sec) + nanoseconds(time.tv_nsec); }

}  // namespace

// A thread: the first one is the process's own.
struct Thread {
  ucontext_t context{};
  void* stack = nullptr;
  void* (*start)(void*) = nullptr;
  void* argument = nullptr;
  void* result = nullptr;
  AsioThreads::context* asio = nullptr;
  bool ended = false;
  bool detached = false;
  // What it waits for; none of them: it is ready.
  const void* condition = nullptr;
  const void* mutex = nullptr;
  const Thread* thread = nullptr;
  bool in_epoll = false;
  std::optional<Moment> deadline;

  [[nodiscard]] bool waits() const {
    return condition != nullptr || mutex != nullptr || thread != nullptr || in_epoll || deadline;
  }
  void wake() {
    condition = mutex = nullptr;
    thread = nullptr;
    in_epoll = false;
    deadline.reset();
  }
};

struct Kernel::Parts {
  explicit Parts(std::uint64_t seed) : random(seed) { threads.push_back(std::make_unique<Thread>()); }

  Random random;
  Moment time{};
  Moment wall_step{};
  std::uint64_t wake_ups = 0;
  bool threads_refused = false;
  bool may_have_events = true;  // a descriptor that the system watches: something was done to one
  std::vector<std::unique_ptr<Thread>> threads;
  Thread* running = nullptr;
  std::vector<void*> stacks;  // free ones

  struct TimerFd {
    int fd = -1;
    std::optional<Moment> due;
    epoll_data_t data{};
    bool watched = false;
  };
  std::vector<TimerFd> timers;
  TimerFd* timer(int fd) {
    const auto found = std::ranges::find(timers, fd, &TimerFd::fd);
    return found == timers.end() ? nullptr : &*found;
  }

  [[nodiscard]] Moment monotonic() const { return kBoot + time; }
  void tick(Moment by) { time += by; }
  std::uint64_t pick(std::uint64_t count) { return random() % count; }

  // Lets others run until the caller, which has said what it waits for, is ready.
  void wait();
  // Others may come first.
  void yield();
  void switch_to(Thread& next);
  Thread* next_ready();
  bool advance();
  int epoll(int epoll_fd, epoll_event* events, int most, int timeout_ms);
  int poll_now(int epoll_fd, epoll_event* events, int most);
  Thread& start(void* (*function)(void*), void* argument);
  void end_running();
};

namespace {

Kernel::Parts* the_kernel = nullptr;
Kernel* the_face = nullptr;
std::vector<void*> free_stacks;

// The kernel if the call is one of the program under it.
Kernel::Parts* kernel() { return the_kernel; }

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
    last->asio = asio_thread();
    asio_thread() = next.asio;
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
Moment Kernel::now() const { return parts_->time; }
std::uint64_t Kernel::wake_ups() const { return parts_->wake_ups; }
Random& Kernel::random() { return parts_->random; }
void Kernel::refuse_threads(bool refused) { parts_->threads_refused = refused; }
void Kernel::step_clock(Moment by) { parts_->wall_step += by; }

void Kernel::sleep(Moment time) {
  parts_->running->deadline = parts_->time + time;
  parts_->wait();
}

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

// The functions of the C library that the program calls; those of the process itself outside a seed.

using porttape::simulation::kernel;
using porttape::simulation::real;
using porttape::simulation::Thread;

extern "C" {

int clock_gettime(clockid_t clock, timespec* time) noexcept {
  auto* const parts = kernel();
  if (parts == nullptr) return static_cast<int>(::syscall(SYS_clock_gettime, clock, time));
  parts->tick(porttape::simulation::kTick);
  if (parts->pick(porttape::simulation::kTurns) == 0) parts->yield();
  porttape::simulation::Moment now = parts->monotonic();
  if (clock == CLOCK_REALTIME) now = porttape::simulation::kWall + parts->time + parts->wall_step;
  time->tv_sec = now / std::chrono::seconds(1);
  time->tv_nsec = (now % std::chrono::seconds(1)).count();
  return 0;
}

int sched_yield() noexcept {
  auto* const parts = kernel();
  if (parts == nullptr) return static_cast<int>(::syscall(SYS_sched_yield));
  parts->tick(porttape::simulation::kYield);
  parts->yield();
  return 0;
}

int getrusage(__rusage_who_t who, rusage* usage) noexcept {
  if (kernel() == nullptr) return static_cast<int>(::syscall(SYS_getrusage, who, usage));
  *usage = {};
  return 0;
}

int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*start)(void*),
                   void* argument) noexcept {
  auto* const parts = kernel();
  if (parts == nullptr) {
    static const auto call = real<decltype(&pthread_create)>("pthread_create");
    return call(thread, attributes, start, argument);
  }
  if (parts->threads_refused) return EAGAIN;
  *thread = reinterpret_cast<pthread_t>(&parts->start(start, argument));
  return 0;
}

int pthread_join(pthread_t thread, void** result) {
  auto* const parts = kernel();
  if (parts == nullptr) {
    static const auto call = real<decltype(&pthread_join)>("pthread_join");
    return call(thread, result);
  }
  auto* const other = reinterpret_cast<Thread*>(thread);
  if (!other->ended) {
    parts->running->thread = other;
    parts->wait();
  }
  if (result != nullptr) *result = other->result;
  other->detached = true;
  return 0;
}

int pthread_detach(pthread_t thread) noexcept {
  if (kernel() == nullptr) {
    static const auto call = real<decltype(&pthread_detach)>("pthread_detach");
    return call(thread);
  }
  reinterpret_cast<Thread*>(thread)->detached = true;
  return 0;
}

int pthread_mutex_lock(pthread_mutex_t* mutex) noexcept {
  static const auto lock = real<decltype(&pthread_mutex_lock)>("pthread_mutex_lock");
  static const auto try_lock = real<decltype(&pthread_mutex_trylock)>("pthread_mutex_trylock");
  auto* const parts = kernel();
  if (parts == nullptr || parts->threads.size() == 1) return lock(mutex);
  if (parts->pick(porttape::simulation::kTurns) == 0) parts->yield();
  while (true) {
    const int error = try_lock(mutex);
    if (error != EBUSY) return error;
    parts->running->mutex = mutex;
    parts->wait();
  }
}

int pthread_mutex_unlock(pthread_mutex_t* mutex) noexcept {
  static const auto unlock = real<decltype(&pthread_mutex_unlock)>("pthread_mutex_unlock");
  const int error = unlock(mutex);
  if (auto* const parts = kernel()) {
    for (const auto& each : parts->threads) {
      if (each->mutex == mutex) each->wake();
    }
  }
  return error;
}

int pthread_cond_clockwait(pthread_cond_t* condition, pthread_mutex_t* mutex, clockid_t clock,
                           const timespec* until) {
  auto* const parts = kernel();
  if (parts == nullptr) {
    static const auto call = real<decltype(&pthread_cond_clockwait)>("pthread_cond_clockwait");
    return call(condition, mutex, clock, until);
  }
  const auto origin =
      clock == CLOCK_REALTIME ? porttape::simulation::kWall + parts->wall_step : porttape::simulation::kBoot;
  const auto deadline = porttape::simulation::moment(*until) - origin;
  parts->running->condition = condition;
  parts->running->deadline = deadline;
  pthread_mutex_unlock(mutex);
  parts->wait();
  const int result = parts->time >= deadline ? ETIMEDOUT : 0;
  pthread_mutex_lock(mutex);
  return result;
}

int pthread_cond_timedwait(pthread_cond_t* condition, pthread_mutex_t* mutex, const timespec* until) {
  if (kernel() == nullptr) {
    static const auto call = real<decltype(&pthread_cond_timedwait)>("pthread_cond_timedwait");
    return call(condition, mutex, until);
  }
  return pthread_cond_clockwait(condition, mutex, CLOCK_REALTIME, until);
}

int pthread_cond_wait(pthread_cond_t* condition, pthread_mutex_t* mutex) {
  auto* const parts = kernel();
  if (parts == nullptr) {
    static const auto call = real<decltype(&pthread_cond_wait)>("pthread_cond_wait");
    return call(condition, mutex);
  }
  parts->running->condition = condition;
  pthread_mutex_unlock(mutex);
  parts->wait();
  pthread_mutex_lock(mutex);
  return 0;
}

int pthread_cond_broadcast(pthread_cond_t* condition) noexcept {
  auto* const parts = kernel();
  if (parts == nullptr) {
    static const auto call = real<decltype(&pthread_cond_broadcast)>("pthread_cond_broadcast");
    return call(condition);
  }
  for (const auto& each : parts->threads) {
    if (each->condition == condition) each->wake();
  }
  return 0;
}

int pthread_cond_signal(pthread_cond_t* condition) noexcept {
  auto* const parts = kernel();
  if (parts == nullptr) {
    static const auto call = real<decltype(&pthread_cond_signal)>("pthread_cond_signal");
    return call(condition);
  }
  std::vector<Thread*> waiting;
  for (const auto& each : parts->threads) {
    if (each->condition == condition) waiting.push_back(each.get());
  }
  if (!waiting.empty()) waiting[parts->pick(waiting.size())]->wake();
  return 0;
}

int timerfd_create(int clock, int flags) noexcept {
  const int fd = static_cast<int>(::syscall(SYS_timerfd_create, clock, flags));
  if (auto* const parts = kernel(); parts != nullptr && fd >= 0) {
    std::erase_if(parts->timers, [fd](const auto& each) { return each.fd == fd; });
    parts->timers.push_back({fd, std::nullopt, {}, false});
  }
  return fd;
}

int timerfd_settime(int fd, int flags, const itimerspec* set, itimerspec* old) noexcept {
  auto* const parts = kernel();
  auto* const timer = parts == nullptr ? nullptr : parts->timer(fd);
  if (timer == nullptr) return static_cast<int>(::syscall(SYS_timerfd_settime, fd, flags, set, old));
  if (old != nullptr) *old = {};
  const auto value = porttape::simulation::moment(set->it_value);
  if (value.count() == 0) {
    timer->due.reset();
  } else {
    timer->due = (flags & TFD_TIMER_ABSTIME) != 0 ? value - porttape::simulation::kBoot : parts->time + value;
  }
  return 0;
}

int epoll_ctl(int epoll_fd, int operation, int fd, epoll_event* event) noexcept {
  auto* const parts = kernel();
  if (auto* const timer = parts == nullptr ? nullptr : parts->timer(fd)) {
    timer->watched = operation != EPOLL_CTL_DEL;
    if (event != nullptr) timer->data = event->data;
    return 0;
  }
  if (parts != nullptr) parts->may_have_events = true;
  return static_cast<int>(::syscall(SYS_epoll_ctl, epoll_fd, operation, fd, event));
}

ssize_t write(int fd, const void* data, std::size_t size) {
  if (auto* const parts = kernel()) parts->may_have_events = true;
  return ::syscall(SYS_write, fd, data, size);
}

int epoll_wait(int epoll_fd, epoll_event* events, int most, int timeout) {
  if (auto* const parts = kernel()) return parts->epoll(epoll_fd, events, most, timeout);
  return static_cast<int>(::syscall(SYS_epoll_pwait, epoll_fd, events, most, timeout, nullptr, 8));
}
}
