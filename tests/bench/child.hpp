#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <sys/types.h>
#include <vector>

#include "tests/bench/line.hpp"

namespace porttape::bench {

// CPU time of a living process, all its threads, in nanoseconds.
std::int64_t cpu_ns(pid_t pid);
// Times its threads went to sleep, and the peak of its resident memory (VmHWM).
std::uint64_t wakeups(pid_t pid);
// Times its threads were put on a processor: those, and when they were sent away from one.
std::uint64_t context_switches(pid_t pid);
std::uint64_t peak_rss_kib(pid_t pid);

// One child process, owned: ended by its pid at the latest in the destructor, and by the kernel if we die.
class Child {
 public:
  Child() = default;
  // Runs `body` in a fork; its status is 0, or 1 with the exception's text on stderr.
  static Child fork(const std::function<void()>& body);
  // Starts a program, found through PATH; its stdout and stderr go to the file `output`, or stay if that is
  // empty.
  static Child run(const std::vector<std::string>& argv, const std::string& output);

  Child(Child&& other) noexcept
      : pid_(std::exchange(other.pid_, -1)), status_(other.status_), group_(other.group_) {}
  Child& operator=(Child&& other) noexcept;
  ~Child();

  [[nodiscard]] pid_t pid() const { return pid_; }
  // The exit status (128 + signal for a killed one), nothing while it runs.
  std::optional<int> poll();
  int wait();
  // SIGTERM, after 5 s SIGKILL.
  int stop();

 private:
  explicit Child(pid_t pid, bool group = false) : pid_(pid), group_(group) {}
  pid_t pid_ = -1;
  std::optional<int> status_;
  bool group_ = false;  // leads a process group of its own, which ends as a whole
};

// The end of what a program wrote to the `output` of Child::run(), for the words of an error.
std::string last_lines(const std::filesystem::path& output);
// Stops a daemon. Throws BenchError with its last lines if its exit status is not 0.
void stop_daemon(Child& daemon, const std::filesystem::path& output);

// Keeps `count` cores busy while it lives.
class BusyCores {
 public:
  explicit BusyCores(int count);

 private:
  std::vector<Child> children_;
};

// Pins this process and all it starts to one CPU; nothing for a negative number.
void pin_to_cpu(int cpu);

}  // namespace porttape::bench
