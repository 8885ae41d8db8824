#pragma once

#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <pthread.h>
#include <semaphore.h>
#include <string>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>
#include <utility>
#include <vector>

namespace porttape::test {

// Many threads of a program that all wait in one system call, for the programs that a supervisor is tested
// with. They are never joined: the program ends with them. A mistake ends the program with status 9.
class Crowd {
 public:
  // `wait` makes the call once, and gives its result. Returns once all are asleep, which is most likely in
  // it.
  Crowd(int size, std::function<ssize_t()> wait) : wait_(std::move(wait)), numbers_(size), threads_(size) {
    ::sem_init(&ends_, 0, 0);
    pthread_attr_t attributes;
    ::pthread_attr_init(&attributes);
    ::pthread_attr_setstacksize(&attributes, std::size_t{128} * 1024);
    for (pthread_t& thread : threads_) {
      if (::pthread_create(&thread, &attributes, run, this) != 0) std::_Exit(9);
    }
    while (begun_ < size) ::usleep(1000);
    for (const std::atomic<pid_t>& number : numbers_) {
      while (!asleep(number)) ::usleep(1000);
    }
  }
  Crowd(const Crowd&) = delete;
  Crowd& operator=(const Crowd&) = delete;

  [[nodiscard]] pthread_t thread(int which) const { return threads_.at(static_cast<std::size_t>(which)); }

  [[nodiscard]] pid_t number(int which) const { return numbers_.at(static_cast<std::size_t>(which)); }

  // Does `send` until one more call has ended, again each second: a signal may come before the call has
  // begun. What that one has come to.
  std::string ended_by(const std::function<void()>& send) {
    do {
      send();
    } while (!ended_within_a_second());
    return interrupted_.exchange(0) > 0 ? "EINTR" : "other";
  }
  // Waits until so many more have given 1.
  void await_ones(int count) {
    while (ones_ < count) (void)ended_within_a_second();
  }

 private:
  static void* run(void* crowd) {
    static_cast<Crowd*>(crowd)->wait_once();
    for (;;) ::pause();
  }

  void wait_once() {
    numbers_.at(static_cast<std::size_t>(begun_++)) = static_cast<pid_t>(::syscall(SYS_gettid));
    const ssize_t result = wait_();
    const int error = errno;
    block_signals();
    if (result < 0 && error == EINTR) ++interrupted_;
    if (result == 1) ++ones_;
    ::sem_post(&ends_);
  }

  // What is sent to the process after this is for those that still wait.
  static void block_signals() {
    sigset_t all;
    ::sigfillset(&all);
    ::pthread_sigmask(SIG_BLOCK, &all, nullptr);
  }

  static bool asleep(pid_t thread) {
    const std::string path = "/proc/self/task/" + std::to_string(thread) + "/stat";
    FILE* const file = std::fopen(path.c_str(), "r");
    char state = '\0';
    const bool known = file != nullptr && std::fscanf(file, "%*d (%*[^)]) %c", &state) == 1;
    if (file != nullptr) std::fclose(file);
    return known && state != 'R';
  }

  bool ended_within_a_second() {
    timespec until{};
    ::clock_gettime(CLOCK_REALTIME, &until);
    ++until.tv_sec;
    return ::sem_timedwait(&ends_, &until) == 0;
  }

  std::function<ssize_t()> wait_;
  std::vector<std::atomic<pid_t>> numbers_;
  std::vector<pthread_t> threads_;
  std::atomic<int> begun_ = 0;
  std::atomic<int> interrupted_ = 0;
  std::atomic<int> ones_ = 0;
  sem_t ends_{};
};

}  // namespace porttape::test
