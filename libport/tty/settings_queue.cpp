#include "libport/tty/settings_queue.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <fcntl.h>
#include <utility>

#include "libport/base/unique_fd.hpp"

namespace porttape {
namespace {

// So long a line may stand still before a change of its settings waits for it no longer.
constexpr Nanos kNoProgress = std::chrono::seconds(1);
// How often it is looked whether the kernel has handed on all bytes.
constexpr Nanos kShortestLook = std::chrono::milliseconds(1);
constexpr Nanos kLongestLook = std::chrono::milliseconds(20);

bool differ_in_flow_only(const LineSettings& one, LineSettings other) {
  other.hw_flow = one.hw_flow;
  other.sw_flow = one.sw_flow;
  return one == other;
}

// How long so many bytes take, at ten bits each.
Nanos time_of(std::size_t bytes, unsigned baud) {
  return Nanos(static_cast<std::int64_t>(bytes * 10) * 1'000'000'000 / std::max(baud, 1U));
}

bool begins_break(const LineSignal& signal) { return signal.name == LineSignal::Name::brk && signal.on; }

// A break that was left out, since the bytes before it stand still, is not the device's error.
std::optional<LineAnswer> answer_of(LineCalls& calls, int fd, const LineRequest& request, int break_error) {
  LineAnswer answer;
  if (request.kind == LineRequest::Kind::last_break) {
    answer.error = break_error == ETIMEDOUT ? 0 : break_error;
  } else {
    answer.error = calls.ask(fd, request, answer);
  }
  const bool knows_none = answer.error == ENOTTY || answer.error == EINVAL;
  if (knows_none && !calls.modem_lines(fd)) return std::nullopt;
  return answer;
}

}  // namespace

Result<TakenSettings> change_settings(LineCalls& calls, int fd, const LineSettings& from,
                                      const LineSettings& wanted, bool wait) {
  if (wait) (void)calls.wait_until_sent(fd, kNoProgress);
  Result<TakenSettings> taken = apply_settings(fd, wanted);
  if (!taken) (void)apply_settings(fd, from);
  return taken;
}

SettingsQueue::SettingsQueue(Loop& loop, Tty tty, const LineSettings& current, Told told)
    : loop_(&loop),
      tty_(std::move(tty)),
      current_(current),
      told_(std::move(told)),
      timer_(loop, [this] { on_timer(); }),
      drain_timer_(loop, [this] { look_for_sent(); }) {}

const LineSettings& SettingsQueue::settings() const {
  for (auto step = steps_.rbegin(); step != steps_.rend(); ++step) {
    if (const auto* const settings = std::get_if<LineSettings>(&step->what)) return *settings;
  }
  return current_;
}

std::vector<LineSettings> SettingsQueue::left() const {
  std::vector<LineSettings> left;
  for (const Step& step : steps_) {
    if (const auto* const settings = std::get_if<LineSettings>(&step.what)) left.push_back(*settings);
  }
  return left;
}

std::size_t SettingsQueue::pending() const {
  std::size_t bytes = outbox().pending();
  for (const Step& step : steps_) bytes += step.after.size();
  return bytes;
}

void SettingsQueue::discard() {
  outbox().discard();
  for (Step& step : steps_) step.after.clear();
  waited_for_ = false;
  if (!drains_.empty()) drain_timer_.set_after(kShortestLook);
}

void SettingsQueue::stop() {
  alive_.reset();
  timer_.cancel();
  drain_timer_.cancel();
  for (const Step& step : steps_) {
    const auto* const job = std::get_if<Job>(&step.what);
    if (job != nullptr && job->dropped) loop_->post(job->dropped);
  }
  end_drains();
}

void SettingsQueue::write(ByteView data) {
  if (steps_.empty()) return outbox().write(data);
  Bytes& after = steps_.back().after;
  after.insert(after.end(), data.begin(), data.end());
  waited_for_ = true;
}

std::size_t SettingsQueue::write_some(ByteView data) {
  if (steps_.empty()) return outbox().write_some(data);
  waited_for_ = true;
  return 0;
}

void SettingsQueue::change(const LineSettings& settings) {
  const bool last_waits = steps_.size() > (making_ ? 1U : 0U);
  auto* const last = last_waits ? std::get_if<LineSettings>(&steps_.back().what) : nullptr;
  if (last == nullptr || !steps_.back().after.empty()) return add({settings, {}});
  *last = settings;
  make_next();
}

void SettingsQueue::signal(const LineSignal& signal) {
  if (signal.name == LineSignal::Name::brk) breaks_ = signal.on;
  if (begins_break(signal)) return add({signal, {}});
  const auto error = std::make_shared<int>(0);
  run({.work = [error, signal, calls = tty_.calls](int fd) { *error = calls->set(fd, signal); },
       .done = [this, error, signal] { told_.signal(signal, *error); }});
}

void SettingsQueue::ask(const LineRequest& request, TakeAnswer done) {
  const auto answer = std::make_shared<std::optional<LineAnswer>>();
  run({.turn = Job::Turn::at_once,
       .work = [answer, request, break_error = break_error_,
                calls = tty_.calls](int fd) { *answer = answer_of(*calls, fd, request, *break_error); },
       .done = [answer, done] { done(*answer); },
       .dropped = [done] { done(LineAnswer{.error = EIO}); }});
}

void SettingsQueue::add(Step step) {
  steps_.push_back(std::move(step));
  make_next();
}

Result<TakenSettings> SettingsQueue::change_at_once(const LineSettings& settings) {
  const Result<TakenSettings> taken = change_settings(*tty_.calls, tty_.fd, current_, settings, false);
  if (taken) current_ = taken->settings;
  return taken;
}

void SettingsQueue::make_next() {
  if (making_ || steps_.empty()) return;
  const auto* const settings = std::get_if<LineSettings>(&steps_.front().what);
  const auto* const job = std::get_if<Job>(&steps_.front().what);
  const bool at_once = settings != nullptr ? differ_in_flow_only(current_, *settings)
                                           : job != nullptr && job->turn == Job::Turn::at_once;
  if (at_once) return begin(false);
  if (!outbox().congested()) return begin(true);
  left_at_look_ = outbox().pending();
  timer_.set_after(kNoProgress);
}

void SettingsQueue::on_timer() {
  if (making_ || steps_.empty()) return;
  if (outbox().pending() == left_at_look_) return begin(false);
  make_next();
}

void SettingsQueue::begin(bool wait) {
  timer_.cancel();
  making_ = true;
  const auto what = steps_.front().what;
  if (const auto* const settings = std::get_if<LineSettings>(&what)) {
    begin_settings(*settings, wait);
  } else if (const auto* const signal = std::get_if<LineSignal>(&what)) {
    begin_break(*signal, wait);
  } else {
    begin_job(std::get<Job>(what));
  }
}

// `without` is done instead, where there is no thread or descriptor for the job.
void SettingsQueue::do_elsewhere(std::function<void(int fd)> job, std::function<void()> done,
                                 const std::function<void()>& without) {
  const auto fd = std::make_shared<UniqueFd>(::fcntl(tty_.fd, F_DUPFD_CLOEXEC, 0));
  const bool begun = *fd && loop_->run_elsewhere(
                                tty_.strand,
                                [fd, job = std::move(job)] {
                                  job(fd->get());
                                  fd->reset();
                                },
                                [done = std::move(done), alive = std::weak_ptr<int>(alive_)] {
                                  if (!alive.expired()) done();
                                });
  if (!begun) without();
}

void SettingsQueue::begin_settings(const LineSettings& wanted, bool wait) {
  const auto taken = std::make_shared<Result<TakenSettings>>(TakenSettings{});
  do_elsewhere([taken, wanted, wait, from = current_,
                calls = tty_.calls](int fd) { *taken = change_settings(*calls, fd, from, wanted, wait); },
               [this, taken, wanted] { settings_made(wanted, *taken); },
               [this, wanted] {
                 settings_made(wanted, change_settings(*tty_.calls, tty_.fd, current_, wanted, false));
               });
}

// The kernel's own wait before a break has no end: it is asked for one that begins only where it need not
// wait.
void SettingsQueue::begin_break(const LineSignal& signal, bool wait) {
  const auto set = [error = break_error_, signal, calls = tty_.calls](int fd, bool sent) {
    *error = sent ? calls->set(fd, signal) : ETIMEDOUT;
  };
  const auto done = [this, signal] {
    made([this, signal, error = *break_error_] { told_.signal(signal, error); });
  };
  do_elsewhere(
      [set, wait, calls = tty_.calls](int fd) { set(fd, wait && calls->wait_until_sent(fd, kNoProgress)); },
      done,
      [this, set, wait, done] {
        set(tty_.fd, wait && tty_.calls->unsent(tty_.fd) == 0);
        done();
      });
}

void SettingsQueue::begin_job(const Job& job) {
  const auto done = [this, done = job.done] {
    made([&done] {
      if (done) done();
    });
  };
  do_elsewhere(job.work, done, [this, job, done] {
    if (!job.waits_long) job.work(tty_.fd);
    done();
  });
}

void SettingsQueue::last_bytes_sent() {
  const auto end = drains_.begin() + static_cast<std::ptrdiff_t>(std::exchange(draining_, 0));
  const std::vector<std::function<void()>> over(drains_.begin(), end);
  drains_.erase(drains_.begin(), end);
  const std::weak_ptr<int> alive = alive_;
  for (const std::function<void()>& drained : over) drained();
  if (!alive.expired()) look_for_sent();
}

void SettingsQueue::settings_made(const LineSettings& wanted, const Result<TakenSettings>& taken) {
  if (taken) current_ = taken->settings;
  made([&] { told_.settings(wanted, taken); });
}

void SettingsQueue::made(const std::function<void()>& tell) {
  making_ = false;
  const Bytes after = std::move(steps_.front().after);
  steps_.pop_front();
  if (!after.empty()) outbox().write(after);
  const std::weak_ptr<int> alive = alive_;
  tell();
  if (alive.expired()) return;
  make_next();
  if (waited_for_) tell_drained();
  if (!alive.expired()) look_for_sent();
}

void SettingsQueue::outbox_drained() {
  if (!steps_.empty()) {
    waited_for_ = true;
    return make_next();
  }
  const std::weak_ptr<int> alive = alive_;
  tell_drained();
  if (!alive.expired()) look_for_sent();
}

void SettingsQueue::tell_drained() {
  if (!steps_.empty() || outbox().congested()) return;
  waited_for_ = false;
  told_.drained();
}

void SettingsQueue::drain(std::function<void()> done) {
  drains_.push_back(std::move(done));
  look_for_sent();
}

// Whether nothing is left but what the UART has. The line may be stopped: nothing but the clock waits for it.
void SettingsQueue::look_for_sent() {
  if (drains_.empty() || !steps_.empty() || outbox().congested()) return;
  const std::size_t left = tty_.calls->unsent(tty_.fd);
  if (left == 0) {
    draining_ = drains_.size();
    return run({.work = [calls = tty_.calls](int fd) { (void)calls->wait_until_sent(fd, kNoProgress); },
                .done = [this] { last_bytes_sent(); },
                .waits_long = true});
  }
  drain_timer_.set_after(std::clamp(time_of(left, current_.baud), kShortestLook, kLongestLook));
}

// From the loop, since the caller may be in the midst of closing the line.
void SettingsQueue::end_drains() {
  drain_timer_.cancel();
  draining_ = 0;
  for (std::function<void()>& done : std::exchange(drains_, {})) loop_->post(std::move(done));
}

}  // namespace porttape
