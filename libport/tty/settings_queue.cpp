#include "libport/tty/settings_queue.hpp"

#include <chrono>
#include <fcntl.h>
#include <utility>

#include "libport/base/unique_fd.hpp"

namespace porttape {
namespace {

// So long a line may stand still before a change of its settings waits for it no longer.
constexpr Nanos kNoProgress = std::chrono::seconds(1);

bool differ_in_flow_only(const LineSettings& one, LineSettings other) {
  other.hw_flow = one.hw_flow;
  other.sw_flow = one.sw_flow;
  return one == other;
}

}  // namespace

Result<TakenSettings> change_settings(int fd, const LineSettings& from, const LineSettings& wanted,
                                      bool wait) {
  const std::atomic<bool> hurry = true;
  if (wait) (void)wait_until_sent(fd, kNoProgress, hurry);
  Result<TakenSettings> taken = apply_settings(fd, wanted);
  if (!taken) (void)apply_settings(fd, from);
  return taken;
}

SettingsQueue::SettingsQueue(Loop& loop, Tty tty, const LineSettings& current, Made on_made,
                             std::function<void()> on_drained)
    : loop_(&loop),
      tty_(std::move(tty)),
      current_(current),
      on_made_(std::move(on_made)),
      on_drained_(std::move(on_drained)),
      timer_(loop, [this] { on_timer(); }) {}

const LineSettings& SettingsQueue::settings() const {
  return changes_.empty() ? current_ : changes_.back().settings;
}

std::vector<LineSettings> SettingsQueue::left() const {
  std::vector<LineSettings> left;
  for (const Change& change : changes_) left.push_back(change.settings);
  return left;
}

std::size_t SettingsQueue::pending() const {
  std::size_t bytes = outbox().pending();
  for (const Change& change : changes_) bytes += change.after.size();
  return bytes;
}

void SettingsQueue::discard() {
  outbox().discard();
  for (Change& change : changes_) change.after.clear();
  waited_for_ = false;
}

void SettingsQueue::stop() {
  alive_.reset();
  timer_.cancel();
}

void SettingsQueue::write(ByteView data) {
  if (changes_.empty()) return outbox().write(data);
  Bytes& after = changes_.back().after;
  after.insert(after.end(), data.begin(), data.end());
  waited_for_ = true;
}

std::size_t SettingsQueue::write_some(ByteView data) {
  if (changes_.empty()) return outbox().write_some(data);
  waited_for_ = true;
  return 0;
}

void SettingsQueue::change(const LineSettings& settings) {
  const bool last_waits = changes_.size() > (making_ ? 1U : 0U);
  if (last_waits && changes_.back().after.empty()) {
    changes_.back().settings = settings;
  } else {
    changes_.push_back({settings, {}});
  }
  make_next();
}

Result<TakenSettings> SettingsQueue::change_at_once(const LineSettings& settings) {
  const Result<TakenSettings> taken = change_settings(tty_.fd, current_, settings, false);
  if (taken) current_ = taken->settings;
  return taken;
}

void SettingsQueue::make_next() {
  if (making_ || changes_.empty()) return;
  if (differ_in_flow_only(current_, changes_.front().settings)) return begin(false);
  if (!outbox().congested()) return begin(true);
  left_at_look_ = outbox().pending();
  timer_.set_after(kNoProgress);
}

void SettingsQueue::on_timer() {
  if (making_ || changes_.empty()) return;
  if (outbox().pending() == left_at_look_) return begin(false);
  make_next();
}

void SettingsQueue::begin(bool wait) {
  timer_.cancel();
  const auto fd = std::make_shared<UniqueFd>(::fcntl(tty_.fd, F_DUPFD_CLOEXEC, 0));
  const auto taken = std::make_shared<Result<TakenSettings>>(TakenSettings{});
  const LineSettings from = current_;
  const LineSettings wanted = changes_.front().settings;
  making_ = true;
  const bool begun = *fd && loop_->run_elsewhere(
                                tty_.strand,
                                [fd, taken, from, wanted, wait] {
                                  *taken = change_settings(fd->get(), from, wanted, wait);
                                  fd->reset();
                                },
                                [this, taken, wanted, alive = std::weak_ptr<int>(alive_)] {
                                  if (!alive.expired()) made(wanted, *taken);
                                });
  if (!begun) made(wanted, change_settings(tty_.fd, from, wanted, false));
}

void SettingsQueue::made(const LineSettings& wanted, const Result<TakenSettings>& taken) {
  making_ = false;
  if (taken) current_ = taken->settings;
  const Bytes after = std::move(changes_.front().after);
  changes_.pop_front();
  if (!after.empty()) outbox().write(after);
  const std::weak_ptr<int> alive = alive_;
  on_made_(wanted, taken);
  if (alive.expired()) return;
  make_next();
  if (waited_for_) tell_drained();
}

void SettingsQueue::outbox_drained() {
  if (changes_.empty()) return tell_drained();
  waited_for_ = true;
  make_next();
}

void SettingsQueue::tell_drained() {
  if (!changes_.empty() || outbox().congested()) return;
  waited_for_ = false;
  on_drained_();
}

}  // namespace porttape
