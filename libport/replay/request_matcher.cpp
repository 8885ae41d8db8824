#include "libport/replay/request_matcher.hpp"

#include <algorithm>
#include <utility>

namespace porttape {
namespace {

constexpr std::size_t kCompactFrom = 4096;

}  // namespace

void RequestMatcher::begin(std::uint64_t offset, bool lost) {
  text_.clear();
  stamps_.clear();
  front_ = 0;
  offset_ = offset;
  paused_ = false;
  lost_ = lost;
  pause_told_ = offset;
  last_write_ = {};
  restart();
}

void RequestMatcher::restart() {
  complete_.clear();
  complete_size_ = depth_ = low_ = 0;
  high_ = index_.sorted().size();
  nearest_ = {};
  trials_.clear();
  for (std::uint32_t kind = 0; expectation_ != nullptr && kind < index_.kinds(); ++kind)
    trials_.push_back({.kind = kind, .comparison = Comparison(expectation_)});
  alive_ = index_.kinds() > 0;
}

void RequestMatcher::add(Instant now, ByteView data) {
  if (data.empty()) return;
  if (lost_ && last_write_ != Instant{} && now >= clock_.silent(last_write_, gap_)) lost_ = false;
  last_write_ = now;
  text_.insert(text_.end(), data.begin(), data.end());
  stamps_.push_back({offset_ + text().size(), now});
}

std::optional<Instant> RequestMatcher::pause_due() const {
  const bool waits = alive_ && complete_size_ == text().size();
  const bool open = std::ranges::any_of(trials_, &Trial::open);
  const bool was_told = pause_told_ == offset_ + text().size();
  if (text().empty() || was_told || (!waits && !open)) return std::nullopt;
  return clock_.silent(last_write_, gap_);
}

RequestMatcher::Step RequestMatcher::next() {
  while (!text().empty()) {
    if (lost_ && !tries_all_) {
      drop(text().size());
      break;
    }
    look();
    const bool decided = !alive_ || (paused_ && complete_size_ == text().size());
    if (!decided) break;
    if (!complete_.empty()) {
      lost_ = false;
      return {Outcome::request, complete_, complete_size_, came_at(offset_ + complete_size_)};
    }
    if (!std::exchange(lost_, true)) return {.outcome = Outcome::unknown};
    drop(1);
  }
  paused_ = false;
  return {};
}

void RequestMatcher::look() {
  if (expectation_ == nullptr) {
    look_plain();
  } else {
    look_by_expectation();
  }
}

// Halves the sorted kinds by one byte after the other.
void RequestMatcher::look_plain() {
  const ByteView text = this->text();
  const std::vector<std::uint32_t>& sorted = index_.sorted();
  while (depth_ < text.size() && low_ < high_) {
    const auto at_depth = [this](std::uint32_t kind) {
      const ByteView request = index_.kind_request(kind);
      return request.size() <= depth_ ? -1 : int{request[depth_]};
    };
    const auto begin = sorted.begin() + static_cast<std::ptrdiff_t>(low_);
    const auto end = sorted.begin() + static_cast<std::ptrdiff_t>(high_);
    const int byte = text[depth_];
    const auto alike_begin = std::ranges::lower_bound(begin, end, byte, {}, at_depth);
    const auto alike_end = std::ranges::upper_bound(alike_begin, end, byte, {}, at_depth);
    came_near(*begin, depth_, depth_);
    low_ = static_cast<std::size_t>(alike_begin - sorted.begin());
    high_ = static_cast<std::size_t>(alike_end - sorted.begin());
    if (low_ == high_) break;
    ++depth_;
    came_near(sorted[high_ - 1], depth_, depth_);  // none of these is longer
    if (index_.kind_request(sorted[low_]).size() == depth_) found(sorted[low_], depth_);
  }
  alive_ = low_ < high_ && index_.kind_request(sorted[high_ - 1]).size() > depth_;
}

void RequestMatcher::look_by_expectation() {
  std::vector<Trial> going;
  for (Trial& trial : trials_) {
    if (advance(trial, paused_)) going.push_back(std::move(trial));
  }
  trials_ = std::move(going);
  alive_ = !trials_.empty();
}

bool RequestMatcher::between() const {
  const std::size_t size = text().size();
  return std::ranges::any_of(trials_, [size](const Trial& trial) {
    return trial.recorded == 0 && trial.came == size && trial.comparison.memory().came.empty();
  });
}

// False when there is nothing more to be known of it.
bool RequestMatcher::advance(Trial& trial, bool pauses) {
  const std::uint32_t exchange = index_.kind(trial.kind).first;
  const std::size_t size = index_.request(exchange).size();
  const ByteView text = this->text();
  while (trial.recorded < size) {
    const ByteView rest = text.subspan(trial.came);
    const bool ends_field = rest.empty() && trial.open && pauses;
    if (rest.empty() && !trial.goes_on && !ends_field) return true;
    const Expectation::Held held = trial.comparison.hold(index_.stretch(exchange, trial.recorded), rest);
    trial.recorded += held.recorded;
    trial.came += held.came;
    came_near(trial.kind, trial.recorded, trial.came);
    if (held.differs) return false;
    const bool nothing = held.recorded == 0 && held.came == 0;
    if (nothing) return rest.empty();
    trial.goes_on = held.goes_on;
    trial.open = held.recorded == 0 && !held.goes_on;
  }
  // What came where an optional frame is left out is no part of the request.
  const std::size_t behind = trial.goes_on ? trial.comparison.memory().came.size() : 0;
  if (behind < trial.came) found(trial.kind, trial.came - behind);
  return false;
}

void RequestMatcher::found(std::uint32_t kind, std::size_t size) {
  if (size > complete_size_) complete_.clear();
  if (size < complete_size_) return;
  complete_size_ = size;
  complete_.push_back(kind);
}

void RequestMatcher::came_near(std::uint32_t kind, std::size_t recorded, std::size_t came) {
  const bool nearer = nearest_.exchange == RequestIndex::kNone || came > nearest_.came;
  if (nearer) nearest_ = {index_.kind(kind).first, recorded, came};
}

Instant RequestMatcher::came_at(std::uint64_t offset) const {
  const auto stamp = std::ranges::lower_bound(stamps_, offset, {}, &Stamp::end);
  return stamp == stamps_.end() ? last_write_ : stamp->at;
}

void RequestMatcher::drop(std::size_t count) {
  front_ += count;
  offset_ += count;
  while (!stamps_.empty() && stamps_.front().end <= offset_) stamps_.pop_front();
  if (front_ == text_.size() || front_ >= kCompactFrom) {
    text_.erase(text_.begin(), text_.begin() + static_cast<std::ptrdiff_t>(front_));
    front_ = 0;
  }
  restart();
}

}  // namespace porttape
