#include "libport/base/workers.hpp"

#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

namespace porttape {
namespace {

using Clock = std::chrono::steady_clock;

constexpr auto kPatience = std::chrono::milliseconds(50);
constexpr int kMostThreads = 64;
constexpr int kMostIdle = 2;

}  // namespace

struct Workers::Strand::State {
  std::deque<std::function<void()>> jobs;  // the front one runs, or is the next to run
};

// Each thread is idle or runs a job. While jobs wait somebody is idle: it takes the oldest strand at once when
// nobody runs a job, else once the strand has waited for kPatience.
struct Workers::State : std::enable_shared_from_this<Workers::State> {
  struct Waiting {
    std::shared_ptr<Strand::State> strand;
    Clock::time_point since;
  };

  bool start_thread();
  void serve();
  void run_front(std::unique_lock<std::mutex>& lock);

  std::mutex mutex;  // guards everything here and every strand's jobs
  std::condition_variable wake;
  std::deque<Waiting> ready;  // strands with a job to run
  int running = 0;
  int idle = 0;
  bool stopped = false;
};

Workers::Strand::Strand() : state_(std::make_shared<State>()) {}

Workers::Workers() : state_(std::make_shared<State>()) {}

Workers::~Workers() {
  std::unique_lock lock(state_->mutex);
  state_->stopped = true;
  state_->ready.clear();
  state_->wake.notify_all();
  state_->wake.wait_for(lock, kPatience, [this] { return state_->running + state_->idle == 0; });
}

bool Workers::post(const Strand& strand, std::function<void()> job) {
  const std::lock_guard lock(state_->mutex);
  if (state_->idle == 0 && !state_->start_thread() && state_->running == 0) return false;
  std::deque<std::function<void()>>& jobs = strand.state_->jobs;
  jobs.push_back(std::move(job));
  if (jobs.size() == 1) {
    state_->ready.push_back({strand.state_, Clock::now()});
    state_->wake.notify_one();
  }
  return true;
}

// An idle one. False where the limits do not allow it: those that are there go on. The mutex is held.
bool Workers::State::start_thread() {
  if (running + idle >= kMostThreads) return false;
  try {
    std::thread([state = shared_from_this()] { state->serve(); }).detach();
  } catch (const std::system_error&) {
    return false;
  }
  ++idle;
  return true;
}

void Workers::State::serve() {
  std::unique_lock lock(mutex);
  while (!stopped) {
    if (ready.empty()) {
      wake.wait(lock);
      continue;
    }
    const Clock::time_point due = ready.front().since + kPatience;
    if (running > 0 && Clock::now() < due) {
      wake.wait_until(lock, due);
      continue;
    }
    --idle;
    ++running;
    if (idle == 0 && !(ready.size() == 1 && running == 1)) (void)start_thread();
    while (!stopped && !ready.empty()) run_front(lock);
    --running;
    ++idle;
    if (idle > kMostIdle) break;
  }
  --idle;
  wake.notify_all();
}

void Workers::State::run_front(std::unique_lock<std::mutex>& lock) {
  const std::shared_ptr<Strand::State> strand = std::move(ready.front().strand);
  ready.pop_front();
  std::function<void()> job = std::move(strand->jobs.front());
  lock.unlock();
  job();
  job = {};
  lock.lock();
  strand->jobs.pop_front();
  if (!stopped && !strand->jobs.empty()) ready.push_back({strand, Clock::now()});
}

}  // namespace porttape
