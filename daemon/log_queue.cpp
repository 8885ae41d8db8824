#include "daemon/log_queue.hpp"

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

namespace porttape {

struct LogQueue::State {
  void serve();
  void write_some(std::unique_lock<std::mutex>& lock);

  std::unique_ptr<LogTarget> target;  // the thread's; without one, guarded by the mutex
  std::function<std::string(std::size_t)> lost_line;

  std::mutex mutex;  // guards the rest
  std::condition_variable wake;
  std::string lines;     // to be written, in order
  std::size_t lost = 0;  // lines, not told yet
  bool reopen = false;
  bool writing = false;
  bool threaded = false;
  bool stopped = false;
};

LogQueue::LogQueue(std::unique_ptr<LogTarget> target, std::function<std::string(std::size_t)> lost_line)
    : state_(std::make_shared<State>()) {
  state_->target = std::move(target);
  state_->lost_line = std::move(lost_line);
  const std::lock_guard lock(state_->mutex);
  try {
    std::thread([state = state_] { state->serve(); }).detach();
    state_->threaded = true;
  } catch (const std::system_error&) {
    state_->threaded = false;
  }
}

LogQueue::~LogQueue() {
  (void)flush();
  const std::lock_guard lock(state_->mutex);
  state_->stopped = true;
  state_->wake.notify_all();
}

void LogQueue::add(std::string_view line) {
  std::unique_lock lock(state_->mutex);
  if (state_->lines.size() + line.size() > kMostBytes) {
    ++state_->lost;
    return;
  }
  state_->lines += line;
  if (!state_->threaded) return state_->write_some(lock);
  state_->wake.notify_all();
}

void LogQueue::reopen() {
  std::unique_lock lock(state_->mutex);
  state_->reopen = true;
  if (!state_->threaded) return state_->write_some(lock);
  state_->wake.notify_all();
}

bool LogQueue::flush() {
  std::unique_lock lock(state_->mutex);
  const auto written = [this] { return state_->lines.empty() && !state_->writing; };
  return state_->wake.wait_for(lock, kFlushLimit, written);
}

void LogQueue::State::serve() {
  std::unique_lock lock(mutex);
  while (!stopped) {
    if (lines.empty() && !reopen) {
      wake.wait(lock);
    } else {
      write_some(lock);
    }
  }
}

// With a thread the target is its own while it writes, and the mutex is free.
void LogQueue::State::write_some(std::unique_lock<std::mutex>& lock) {
  const bool opens = std::exchange(reopen, false);
  const std::size_t telling = std::exchange(lost, 0);
  const std::string batch = std::exchange(lines, {});
  writing = true;
  if (threaded) lock.unlock();
  if (opens) target->reopen();
  const bool told = telling == 0 || target->write(lost_line(telling));
  const bool taken = batch.empty() || target->write(batch);
  if (threaded) lock.lock();
  writing = false;
  if (!told) lost += telling;
  if (!taken) lost += static_cast<std::size_t>(std::ranges::count(batch, '\n'));
  wake.notify_all();
}

}  // namespace porttape
