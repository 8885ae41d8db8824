#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

namespace porttape {

// Where lines of a log end up. Its functions may wait; the queue calls them from one thread at a time.
class LogTarget {
 public:
  LogTarget() = default;
  LogTarget(const LogTarget&) = delete;
  LogTarget& operator=(const LogTarget&) = delete;
  virtual ~LogTarget() = default;

  // Whole lines, each with its newline. False: they are lost.
  virtual bool write(std::string_view lines) = 0;
  // Opens a file of the same name again (it was moved away).
  virtual void reopen() {}
};

// A log that never waits for its target: lines go to a bounded queue, and a thread of its own writes them.
// Lines that find the queue full, or that the target did not take, are counted, and a line tells how many
// once writing works again. Where no thread is to be had, lines are written at once.
//
// The destructor gives the target kFlushLimit to take what is queued; a target that hangs is left to itself
// with its thread, and what is queued is lost. Any thread may call.
class LogQueue {
 public:
  static constexpr std::size_t kMostBytes = std::size_t{1} << 20;
  static constexpr auto kFlushLimit = std::chrono::seconds(1);

  // `lost_line` makes the line that tells of lost ones.
  LogQueue(std::unique_ptr<LogTarget> target, std::function<std::string(std::size_t lines)> lost_line);
  ~LogQueue();
  LogQueue(const LogQueue&) = delete;
  LogQueue& operator=(const LogQueue&) = delete;

  void add(std::string_view line);
  void reopen();
  // Waits until all has been written, kFlushLimit at most.
  bool flush();

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace porttape
