#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <sys/epoll.h>
#include <ucontext.h>
#include <vector>

#include "tests/simulation/kernel.hpp"

namespace porttape::simulation {

// A thread: the first one is the process's own.
struct Thread {
  ucontext_t context{};
  void* stack = nullptr;
  void* (*start)(void*) = nullptr;
  void* argument = nullptr;
  void* result = nullptr;
  void* asio = nullptr;  // what Asio keeps for each thread
  bool ended = false;
  bool detached = false;
  // What it waits for; none of them: it is ready.
  const void* condition = nullptr;
  const void* mutex = nullptr;
  const Thread* thread = nullptr;
  bool in_epoll = false;
  std::optional<Kernel::Moment> deadline;

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
  // The monotonic clock at a seed's start, and the wall clock's.
  static constexpr Moment kBoot = std::chrono::seconds(1000);
  static constexpr Moment kWall = std::chrono::seconds(1'700'000'000);

  // Those of the kernel that exists: the call is one of the program under it. Null outside a seed.
  static Parts* current();

  explicit Parts(std::uint64_t seed) : random(seed) { threads.push_back(std::make_unique<Thread>()); }

  Random random;
  Moment time{};
  Moment wall_step{};
  std::uint64_t wake_ups = 0;
  bool threads_refused = false;
  bool may_have_events = true;  // a descriptor that the system watches: something was done to one
  std::vector<std::unique_ptr<Thread>> threads;
  Thread* running = nullptr;

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
  [[nodiscard]] Moment wall() const { return kWall + time + wall_step; }
  void tick(Moment by) { time += by; }
  // What reading a clock costs, and how often whoever reads one or takes a lock lets others go first: one
  // time in this many.
  static constexpr Moment kTick = std::chrono::nanoseconds(40);
  static constexpr std::uint64_t kTurns = 16;
  void read_a_clock() {
    tick(kTick);
    if (pick(kTurns) == 0) yield();
  }
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

}  // namespace porttape::simulation
