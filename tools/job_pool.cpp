#include "tools/job_pool.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <fmt/format.h>
#include <poll.h>
#include <sys/signalfd.h>
#include <unistd.h>
#include <utility>

#include "tools/command_end.hpp"
#include "tools/tool_log.hpp"
#include "tools/verb_clock.hpp"

namespace porttape {
Result<std::unique_ptr<JobPool>> JobPool::make(Options options) {
  std::unique_ptr<JobPool> pool(new JobPool(std::move(options)));
  if (Result<void> watched = pool->watch_signals(); !watched) return watched.error();
  if (Result<void> adopted = pool->family_.adopt(); !adopted) return adopted.error();
  return pool;
}

JobPool::JobPool(Options options) : options_(std::move(options)) {
  options_.workers = std::max<std::size_t>(options_.workers, 1);
}

JobPool::~JobPool() {
  cancel();
  end_all();
  if (!signal_fd_) return;
  signalfd_siginfo info{};
  while (signal_ != 0 && ::read(signal_fd_.get(), &info, sizeof info) > 0) {
  }
  ::sigprocmask(SIG_SETMASK, &before_, nullptr);
}

Result<void> JobPool::watch_signals() {
  ::sigemptyset(&signals_);
  for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) {
    if (!is_ignored(number)) ::sigaddset(&signals_, number);
  }
  signal_fd_.reset(::signalfd(-1, &signals_, SFD_NONBLOCK | SFD_CLOEXEC));
  if (!signal_fd_) return make_error(Errc::io, "watching for signals: " + errno_text(errno));
  ::sigprocmask(SIG_BLOCK, &signals_, &before_);
  return {};
}

std::size_t JobPool::add(std::string job) {
  waiting_.push_back({added_, std::move(job)});
  return added_++;
}

std::size_t JobPool::running() const {
  return static_cast<std::size_t>(
      std::ranges::count_if(workers_, [](const auto& worker) { return worker->busy(); }));
}

std::optional<JobDone> JobPool::wait(std::optional<Instant> until) {
  for (;;) {
    give_jobs();
    while (!done_.empty()) {
      JobDone next = std::move(done_.front());
      done_.pop_front();
      if (next.job >= told_from_) return next;
    }
    const bool tells = std::ranges::any_of(
        workers_, [this](const auto& worker) { return worker->job() && *worker->job() >= told_from_; });
    if (!tells && waiting_.empty()) return std::nullopt;
    if (until && verb_clock().now() >= *until) return std::nullopt;
    poll_all(until);
    take_signal();
    look_at_all();
  }
}

void JobPool::give_jobs() {
  if (signal_ != 0) waiting_.clear();
  while (!waiting_.empty()) {
    JobWorker* worker = idle_worker();
    if (worker == nullptr && !workers_.empty() && running() > 0) return;  // later
    Job job = std::move(waiting_.front());
    waiting_.pop_front();
    if (worker == nullptr) {
      done_.push_back({.job = job.number, .trouble = refused_});
      continue;
    }
    std::optional<Instant> end;
    if (options_.limit) end = verb_clock().now() + *options_.limit;
    worker->give(job.number, job.text, end,
                 fmt::format("took longer than {} s, and was ended",
                             std::chrono::duration<double>(options_.limit.value_or(Nanos{})).count()));
  }
}

// One that waits for a job, or a new one; none where all are busy, or no process is to be had.
JobWorker* JobPool::idle_worker() {
  for (const auto& worker : workers_) {
    if (!worker->busy() && !worker->gone()) return worker.get();
  }
  if (workers_.size() >= options_.workers) return nullptr;
  auto started = JobWorker::start(options_.work, [this] {
    ::sigprocmask(SIG_SETMASK, &before_, nullptr);
    for (auto& worker : workers_) worker->forget();
    signal_fd_.reset();
  });
  if (!started) {
    refused_ = started.error().message;
    return nullptr;
  }
  family_.spare((*started)->pid());
  return workers_.emplace_back(std::move(*started)).get();
}

void JobPool::poll_all(std::optional<Instant> until) {
  std::vector<pollfd> polled{{.fd = signal_fd_.get(), .events = POLLIN, .revents = 0}};
  for (const auto& worker : workers_) {
    worker->add_to(polled);
    if (const auto deadline = worker->deadline(); deadline && (!until || *deadline < *until))
      until = deadline;
  }
  int limit = -1;
  if (until) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(*until - verb_clock().now());
    limit = static_cast<int>(std::clamp<std::int64_t>(left.count(), 0, 60'000));
  }
  (void)::poll(polled.data(), polled.size(), limit);
}

void JobPool::look_at_all() {
  for (const auto& worker : workers_) {
    if (auto done = worker->look()) done_.push_back(std::move(*done));
  }
  replace_gone();
}

// The first one goes to the workers, as far as a terminal has not sent it to them already.
void JobPool::take_signal() {
  signalfd_siginfo info{};
  while (::read(signal_fd_.get(), &info, sizeof info) == sizeof info) {
    const bool first = signal_ == 0;
    if (first) signal_ = static_cast<int>(info.ssi_signo);
    const int passed_on = info.ssi_code == SI_KERNEL ? 0 : signal_;
    for (const auto& worker : workers_) {
      if (!worker->busy()) continue;
      if (first) worker->end(passed_on, "interrupted by " + signal_text(signal_));
      if (!first) worker->kill();
    }
  }
}

void JobPool::replace_gone() {
  if (std::erase_if(workers_, [](const auto& worker) { return worker->gone() && !worker->busy(); }) > 0)
    (void)family_.end(CommandFamily::kTermLimit, CommandFamily::kKillLimit);
}

void JobPool::cancel() {
  waiting_.clear();
  done_.clear();
  told_from_ = added_;
  for (const auto& worker : workers_) {
    if (worker->busy()) worker->end(SIGTERM, "cancelled");
  }
}

void JobPool::end_all() {
  for (const auto& worker : workers_) worker->close();
  while (running() > 0) {
    poll_all({});
    take_signal();
    look_at_all();
  }
  workers_.clear();
  (void)family_.end(CommandFamily::kTermLimit, CommandFamily::kKillLimit);
}

}  // namespace porttape
