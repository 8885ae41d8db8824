#include "libport/loop/loop.hpp"

#include <algorithm>
#include <chrono>
#include <exception>
#include <mutex>
#include <optional>
#include <sched.h>
#include <stdexcept>
#include <string>
#include <utility>

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>

#include "libport/loop/file_events.hpp"
#include "libport/loop/sampler.hpp"
#include "libport/loop/timer_queue.hpp"
#include "libport/loop/urgent_events.hpp"

namespace porttape {
namespace {

// How long a loop polls before it sleeps, and after which part of that it lets others run.
constexpr Nanos kPollLimit = std::chrono::microseconds(25);
constexpr Nanos kPollAlone = std::chrono::microseconds(2);

}  // namespace

// Where other threads reach the loop, as long as it is there. Keeps it waiting while jobs are under way.
struct Loop::Gate {
  using Work = boost::asio::executor_work_guard<boost::asio::io_context::executor_type>;

  explicit Gate(boost::asio::io_context& context) : io(&context) {}

  void begin() {
    const std::lock_guard lock(mutex);
    if (io != nullptr && ++under_way == 1) work.emplace(io->get_executor());
  }
  void finish(const std::function<void()>& done) {
    const std::lock_guard lock(mutex);
    if (io == nullptr) return;
    if (done) boost::asio::post(*io, done);
    if (--under_way == 0) work.reset();
  }
  void post(std::function<void()> task) {
    const std::lock_guard lock(mutex);
    if (io != nullptr) boost::asio::post(*io, std::move(task));
  }
  bool busy() {
    const std::lock_guard lock(mutex);
    return under_way > 0;
  }
  void shut() {
    const std::lock_guard lock(mutex);
    work.reset();
    io = nullptr;
  }

  std::mutex mutex;  // guards the rest
  boost::asio::io_context* io;
  int under_way = 0;
  std::optional<Work> work;
};

// BOOST_ASIO_CONCURRENCY_HINT_UNSAFE_IO would also drop the reactor's locks, but post() from a second thread
// needs them.
Loop::Loop(const Clock& clock, const Clock& machine)
    : clock_(&clock),
      machine_(&machine),
      io_(std::make_unique<boost::asio::io_context>(1)),
      timers_(std::make_unique<TimerQueue>(*io_, clock)),
      machine_timers_(&clock == &machine ? nullptr : std::make_unique<TimerQueue>(*io_, machine)),
      gate_(std::make_shared<Gate>(*io_)) {}
Loop::~Loop() {
  gate_->shut();
  sampler_.reset();
  file_events_.reset();
  // Handlers that are left go with the io_context, and may have timers.
  for (const auto& queue : {&timers_, &machine_timers_}) {
    if (*queue) (*queue)->close();
  }
  io_.reset();
}

bool Loop::run_elsewhere(const Workers::Strand& strand, std::function<void()> job,
                         std::function<void()> done) {
  gate_->begin();
  const bool taken = workers_.post(
      strand, [this, gate = gate_, fence = fence_, job = std::move(job), done = fenced(std::move(done))] {
        try {
          job();
        } catch (const std::exception& error) {
          const auto rethrow = [what = std::string(error.what())] { throw std::runtime_error(what); };
          return gate->finish([this, fence, rethrow] { within(fence, rethrow); });
        }
        gate->finish(done);
      });
  if (!taken) gate_->finish({});
  return taken;
}

void Loop::run() {
  Instant idle_since = machine_->now();
  running_since_ = now();
  handler_began_ = Instant::max();
  for (;;) {
    const bool polls = patience_.expects_soon(idle_since);
    const bool soon = polls && poll_from(idle_since);
    if (polls) patience_.poll_ended(soon, idle_since);
    if (!soon && io_->run_one() == 0) break;
    const Instant end = machine_->now();
    if (!soon) patience_.waited(end - idle_since);
    handled(clock_ == machine_ ? end : now());
    idle_since = end;
  }
  running_since_ = Instant::max();
}

// A handler without a begin of its own (a signal's, an answer's) is not measured.
void Loop::handled(Instant end) {
  stalls_.late(std::max(handler_began_, running_since_), end);
  handler_began_ = Instant::max();
}

void Loop::timer_comes(const TimerQueue& timers, Instant expected) {
  handler_began_ = now();
  if (&timers == timers_.get()) stalls_.late(std::max(expected, running_since_), handler_began_);
}

std::optional<Instant> Loop::next_timer() const { return timers_->earliest(); }
void Loop::clock_moved() { timers_->clock_moved(); }
bool Loop::has_jobs() const { return gate_->busy(); }

std::function<void(std::function<void()>)> Loop::poster() {
  return [this, gate = gate_, fence = fence_](std::function<void()> task) {
    gate->post([this, fence, task = std::move(task)] { within(fence, task); });
  };
}

// True once an event was handled.
bool Loop::poll_from(Instant start) {
  for (Instant last = start; !io_->stopped();) {
    if (io_->poll_one() != 0) return true;
    const Instant next = machine_->now();
    patience_.polled(last, next);
    if (!patience_.expects_soon(next) || next - start >= kPollLimit) return false;
    if (next - start >= kPollAlone) ::sched_yield();  // the peer may be waiting for this very processor
    last = next;
  }
  return false;
}

bool Loop::run_one() {
  running_since_ = now();
  handler_began_ = Instant::max();
  const bool ran = io_->run_one() != 0;
  handled(now());
  running_since_ = Instant::max();
  return ran;
}
bool Loop::poll_one() { return io_->poll_one() != 0; }
void Loop::stop() { io_->stop(); }
void Loop::restart() { io_->restart(); }

std::span<Byte> Loop::read_buffer() {
  if (!read_buffer_) read_buffer_ = std::make_unique<Byte[]>(kReadBuffer);
  return {read_buffer_.get(), kReadBuffer};
}

FileEvents& Loop::file_events() {
  // Everybody's, so behind nobody's fence; the same below.
  if (!file_events_) within(nullptr, [this] { file_events_ = std::make_unique<FileEvents>(*this); });
  return *file_events_;
}

Sampler& Loop::sampler() {
  if (!sampler_) within(nullptr, [this] { sampler_ = std::make_unique<Sampler>(*this); });
  return *sampler_;
}

UrgentEvents& Loop::urgent_events() {
  if (!urgent_events_) urgent_events_ = std::make_unique<UrgentEvents>();
  return *urgent_events_;
}

void Loop::post(std::function<void()> task) { boost::asio::post(*io_, fenced(std::move(task))); }

void Loop::within(const std::shared_ptr<Fence>& fence, const std::function<void()>& work) {
  if (handler_began_ == Instant::max()) handler_began_ = now();  // else this is a part of a handler
  const std::shared_ptr<Fence> outer = std::exchange(fence_, fence);
  try {
    work();
    fence_ = outer;
  } catch (const std::exception& error) {
    fence_ = outer;
    if (!fence) throw;
    fence->on_exception(error.what());
  }
}

// The task behind the fence of the one who posts it.
std::function<void()> Loop::fenced(std::function<void()> task) {
  if (!task) return task;
  return [this, fence = fence_, task = std::move(task)] { within(fence, task); };
}

}  // namespace porttape
