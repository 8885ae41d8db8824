#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <stop_token>
#include <thread>

#include "libport/tape/tape_sink.hpp"

namespace porttape {

// Syncs sinks once an interval if something was written, on a thread of its own. Keeps references to the
// sinks: they must outlive it. note_write() and error() may be called from any thread.
class SyncThread {
 public:
  using Sinks = std::array<TapeSink*, 3>;

  explicit SyncThread(const Sinks& sinks, std::chrono::milliseconds interval = std::chrono::seconds(1))
      : sinks_(sinks), interval_(interval), thread_([this](const std::stop_token& stop) { run(stop); }) {}

  void note_write() { written_.store(true, std::memory_order_relaxed); }
  // The errno of the first sync that failed, 0 if none has.
  [[nodiscard]] int error() const { return error_.load(std::memory_order_relaxed); }

  // Ends the thread. Waits for a sync that is under way.
  void stop() {
    thread_.request_stop();
    if (thread_.joinable()) thread_.join();
  }

 private:
  void run(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    while (!stop.stop_requested()) {
      wake_.wait_for(lock, stop, interval_, [] { return false; });
      if (stop.stop_requested() || !written_.exchange(false, std::memory_order_relaxed)) continue;
      for (TapeSink* sink : sinks_) {
        int none = 0;
        if (const int error = sink->sync(); error != 0) error_.compare_exchange_strong(none, error);
      }
    }
  }

  Sinks sinks_;
  std::chrono::milliseconds interval_;
  std::atomic<bool> written_ = false;
  std::atomic<int> error_ = 0;
  std::mutex mutex_;
  std::condition_variable_any wake_;
  std::jthread thread_;  // last: it uses the others
};

}  // namespace porttape
