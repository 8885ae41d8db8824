#include "libport/base/workers.hpp"

#include <chrono>
#include <condition_variable>
#include <deque>
#include <exception>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include "libport/base/clock.hpp"

namespace porttape {
namespace {

constexpr auto kPatience = std::chrono::milliseconds(10);
constexpr auto kEndPatience = std::chrono::milliseconds(50);
constexpr int kMostThreads = 64;
constexpr int kMostIdle = 2;

}  // namespace

struct Workers::Strand::State {
  std::deque<std::function<void()>> jobs;  // the front one runs, or is the next to run
};

// Each thread is idle or runs a job. While jobs wait somebody is idle: it takes the oldest strand at once
// when nobody runs a job, else once the strand has waited for kPatience.
struct Workers::State : std::enable_shared_from_this<Workers::State> {
  struct Waiting {
    std::shared_ptr<Strand::State> strand;
    Instant since;
  };
  struct Later {
    std::shared_ptr<Strand::State> strand;
    std::function<void()> job;
  };

  bool start_thread();
  bool have_idle() { return idle > 0 || start_thread() || running > 0; }
  void put(const std::shared_ptr<Strand::State>& strand, std::function<void()> job);
  void take_due();
  void wait_for_work(std::unique_lock<std::mutex>& lock);
  void serve();
  void run_front(std::unique_lock<std::mutex>& lock);

  std::mutex mutex;  // guards everything here and every strand's jobs
  std::condition_variable wake;
  std::deque<Waiting> ready;  // strands with a job to run
  std::multimap<Instant, Later> later;
  bool watched = false;  // an idle thread waits for the first of `later`
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
  state_->later.clear();
  state_->wake.notify_all();
  state_->wake.wait_for(lock, kEndPatience, [this] { return state_->running + state_->idle == 0; });
}

bool Workers::post(const Strand& strand, std::function<void()> job) {
  const std::lock_guard lock(state_->mutex);
  if (!state_->have_idle()) return false;
  state_->put(strand.state_, std::move(job));
  return true;
}

bool Workers::post_at(Instant when, const Strand& strand, std::function<void()> job) {
  const std::lock_guard lock(state_->mutex);
  if (!state_->have_idle()) return false;
  const auto place = state_->later.emplace(when, State::Later{strand.state_, std::move(job)});
  // Whoever waits for a later one has to look again.
  if (place == state_->later.begin()) state_->wake.notify_all();
  return true;
}

void Workers::State::put(const std::shared_ptr<Strand::State>& strand, std::function<void()> job) {
  strand->jobs.push_back(std::move(job));
  if (strand->jobs.size() > 1) return;
  ready.push_back({strand, machine_clock().now()});
  wake.notify_one();
}

void Workers::State::take_due() {
  const Instant now = later.empty() ? Instant{} : machine_clock().now();
  while (!later.empty() && later.begin()->first <= now) {
    Later due = std::move(later.extract(later.begin()).mapped());
    put(due.strand, std::move(due.job));
  }
}

// An idle one. False where the limits do not allow it: those that are there go on. The mutex is held.
bool Workers::State::start_thread() {
  if (running + idle >= kMostThreads) return false;
  try {
    std::thread([state = shared_from_this()] { state->serve(); }).detach();
  } catch (const std::exception&) {  // no thread, or no memory
    return false;
  }
  ++idle;
  return true;
}

void Workers::State::wait_for_work(std::unique_lock<std::mutex>& lock) {
  if (later.empty() || watched) return wake.wait(lock);
  watched = true;
  const Instant due = later.begin()->first;  // a copy: the entry may be gone when it looks again
  wake.wait_until(lock, due);
  watched = false;
}

void Workers::State::serve() {
  std::unique_lock lock(mutex);
  while (!stopped) {
    take_due();
    if (ready.empty()) {
      wait_for_work(lock);
      continue;
    }
    const Instant due = ready.front().since + kPatience;
    if (running > 0 && machine_clock().now() < due) {
      wake.wait_until(lock, due);
      continue;
    }
    --idle;
    ++running;
    if (idle == 0 && (ready.size() > 1 || running > 1 || !later.empty())) (void)start_thread();
    if (!later.empty()) wake.notify_one();  // somebody else watches now
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
  if (!stopped && !strand->jobs.empty()) ready.push_back({strand, machine_clock().now()});
}

}  // namespace porttape
