// The functions of the C library by which the program would wait or ask the time: those of the simulated
// kernel while there is one, else the library's own.

#include <cerrno>
#include <chrono>
#include <pthread.h>
#include <sched.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>
#include <vector>

#include "tests/simulation/kernel_parts.hpp"
#include "tests/support/next_call.hpp"

using porttape::next_call;
using porttape::simulation::Kernel;
using porttape::simulation::Thread;

namespace {

// What a turn costs that is given to others; a program that polls until a moment would never get there else.
constexpr Kernel::Moment kYield = std::chrono::microseconds(2);

Kernel::Moment moment(const timespec& time) {
  return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}

}  // namespace

extern "C" {

int clock_gettime(clockid_t clock, timespec* time) noexcept {
  auto* const parts = Kernel::Parts::current();
  if (parts == nullptr) return static_cast<int>(::syscall(SYS_clock_gettime, clock, time));
  parts->read_a_clock();
  const Kernel::Moment now = clock == CLOCK_REALTIME ? parts->wall() : parts->monotonic();
  time->tv_sec = now / std::chrono::seconds(1);
  time->tv_nsec = (now % std::chrono::seconds(1)).count();
  return 0;
}

int sched_yield() noexcept {
  auto* const parts = Kernel::Parts::current();
  if (parts == nullptr) return static_cast<int>(::syscall(SYS_sched_yield));
  parts->tick(kYield);
  parts->yield();
  return 0;
}

int getrusage(__rusage_who_t who, rusage* usage) noexcept {
  if (Kernel::Parts::current() == nullptr) return static_cast<int>(::syscall(SYS_getrusage, who, usage));
  *usage = {};
  return 0;
}

int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*start)(void*),
                   void* argument) noexcept {
  auto* const parts = Kernel::Parts::current();
  if (parts == nullptr) {
    static const auto call = next_call<decltype(&pthread_create)>("pthread_create");
    return call(thread, attributes, start, argument);
  }
  if (parts->threads_refused) return EAGAIN;
  *thread = reinterpret_cast<pthread_t>(&parts->start(start, argument));
  return 0;
}

int pthread_join(pthread_t thread, void** result) {
  auto* const parts = Kernel::Parts::current();
  if (parts == nullptr) {
    static const auto call = next_call<decltype(&pthread_join)>("pthread_join");
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
  if (Kernel::Parts::current() == nullptr) {
    static const auto call = next_call<decltype(&pthread_detach)>("pthread_detach");
    return call(thread);
  }
  reinterpret_cast<Thread*>(thread)->detached = true;
  return 0;
}

int pthread_mutex_lock(pthread_mutex_t* mutex) noexcept {
  static const auto lock = next_call<decltype(&pthread_mutex_lock)>("pthread_mutex_lock");
  static const auto try_lock = next_call<decltype(&pthread_mutex_trylock)>("pthread_mutex_trylock");
  auto* const parts = Kernel::Parts::current();
  if (parts == nullptr || parts->threads.size() == 1) return lock(mutex);
  if (parts->pick(Kernel::Parts::kTurns) == 0) parts->yield();
  while (true) {
    const int error = try_lock(mutex);
    if (error != EBUSY) return error;
    parts->running->mutex = mutex;
    parts->wait();
  }
}

int pthread_mutex_unlock(pthread_mutex_t* mutex) noexcept {
  static const auto unlock = next_call<decltype(&pthread_mutex_unlock)>("pthread_mutex_unlock");
  const int error = unlock(mutex);
  if (auto* const parts = Kernel::Parts::current()) {
    for (const auto& each : parts->threads) {
      if (each->mutex == mutex) each->wake();
    }
  }
  return error;
}

int pthread_cond_clockwait(pthread_cond_t* condition, pthread_mutex_t* mutex, clockid_t clock,
                           const timespec* until) {
  auto* const parts = Kernel::Parts::current();
  if (parts == nullptr) {
    static const auto call = next_call<decltype(&pthread_cond_clockwait)>("pthread_cond_clockwait");
    return call(condition, mutex, clock, until);
  }
  const Kernel::Moment now = clock == CLOCK_REALTIME ? parts->wall() : parts->monotonic();
  const Kernel::Moment deadline = parts->time + moment(*until) - now;
  parts->running->condition = condition;
  parts->running->deadline = deadline;
  pthread_mutex_unlock(mutex);
  parts->wait();
  const int result = parts->time >= deadline ? ETIMEDOUT : 0;
  pthread_mutex_lock(mutex);
  return result;
}

int pthread_cond_timedwait(pthread_cond_t* condition, pthread_mutex_t* mutex, const timespec* until) {
  if (Kernel::Parts::current() == nullptr) {
    static const auto call = next_call<decltype(&pthread_cond_timedwait)>("pthread_cond_timedwait");
    return call(condition, mutex, until);
  }
  return pthread_cond_clockwait(condition, mutex, CLOCK_REALTIME, until);
}

int pthread_cond_wait(pthread_cond_t* condition, pthread_mutex_t* mutex) {
  auto* const parts = Kernel::Parts::current();
  if (parts == nullptr) {
    static const auto call = next_call<decltype(&pthread_cond_wait)>("pthread_cond_wait");
    return call(condition, mutex);
  }
  parts->running->condition = condition;
  pthread_mutex_unlock(mutex);
  parts->wait();
  pthread_mutex_lock(mutex);
  return 0;
}

int pthread_cond_broadcast(pthread_cond_t* condition) noexcept {
  auto* const parts = Kernel::Parts::current();
  if (parts == nullptr) {
    static const auto call = next_call<decltype(&pthread_cond_broadcast)>("pthread_cond_broadcast");
    return call(condition);
  }
  for (const auto& each : parts->threads) {
    if (each->condition == condition) each->wake();
  }
  return 0;
}

int pthread_cond_signal(pthread_cond_t* condition) noexcept {
  auto* const parts = Kernel::Parts::current();
  if (parts == nullptr) {
    static const auto call = next_call<decltype(&pthread_cond_signal)>("pthread_cond_signal");
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
  if (auto* const parts = Kernel::Parts::current(); parts != nullptr && fd >= 0) {
    std::erase_if(parts->timers, [fd](const auto& each) { return each.fd == fd; });
    parts->timers.push_back({fd, std::nullopt, {}, false});
  }
  return fd;
}

int timerfd_settime(int fd, int flags, const itimerspec* set, itimerspec* old) noexcept {
  auto* const parts = Kernel::Parts::current();
  auto* const timer = parts == nullptr ? nullptr : parts->timer(fd);
  if (timer == nullptr) return static_cast<int>(::syscall(SYS_timerfd_settime, fd, flags, set, old));
  if (old != nullptr) *old = {};
  const auto value = moment(set->it_value);
  if (value.count() == 0) {
    timer->due.reset();
  } else {
    timer->due = (flags & TFD_TIMER_ABSTIME) != 0 ? value - Kernel::Parts::kBoot : parts->time + value;
  }
  return 0;
}

int epoll_ctl(int epoll_fd, int operation, int fd, epoll_event* event) noexcept {
  auto* const parts = Kernel::Parts::current();
  if (auto* const timer = parts == nullptr ? nullptr : parts->timer(fd)) {
    timer->watched = operation != EPOLL_CTL_DEL;
    if (event != nullptr) timer->data = event->data;
    return 0;
  }
  if (parts != nullptr) parts->may_have_events = true;
  return static_cast<int>(::syscall(SYS_epoll_ctl, epoll_fd, operation, fd, event));
}

ssize_t write(int fd, const void* data, std::size_t size) {
  if (auto* const parts = Kernel::Parts::current()) parts->may_have_events = true;
  return ::syscall(SYS_write, fd, data, size);
}

int epoll_wait(int epoll_fd, epoll_event* events, int most, int timeout) {
  if (auto* const parts = Kernel::Parts::current()) return parts->epoll(epoll_fd, events, most, timeout);
  return static_cast<int>(::syscall(SYS_epoll_pwait, epoll_fd, events, most, timeout, nullptr, 8));
}
}
