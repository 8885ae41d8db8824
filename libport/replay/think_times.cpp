#include "libport/replay/think_times.hpp"

#include <algorithm>
#include <chrono>

namespace porttape {
namespace {

// A driver may write before the answer is there: that took no time.
Micros at_least_none(Nanos time) { return std::max(std::chrono::round<Micros>(time), Micros{0}); }

}  // namespace

void ThinkTimer::expect(std::uint64_t end, TapeTime at, std::uint64_t exchange) {
  if (!answered_) return;
  request_ = Request{end, *answered_, at, exchange};
  answered_.reset();
}

std::optional<std::uint64_t> ThinkTimer::expected() const {
  return request_ ? std::optional(request_->end) : std::nullopt;
}

void ThinkTimer::came(Instant now, double rate) {
  if (!request_) return;
  const auto recorded = std::chrono::duration_cast<Nanos>((request_->at - request_->after.at) / rate);
  add(now - request_->after.real, recorded, request_->exchange);
  request_.reset();
}

void ThinkTimer::forget() {
  answered_.reset();
  request_.reset();
}

void ThinkTimer::add(Nanos real, Nanos recorded, std::uint64_t exchange) {
  const Micros took = at_least_none(real);
  if (real_.count() == 0 || took > most_) {
    most_ = took;
    most_at_ = exchange;
  }
  real_.add(took.count());
  recorded_.add(at_least_none(recorded).count());
}

std::optional<ThinkTimes> ThinkTimer::times() const {
  if (real_.count() == 0) return std::nullopt;
  return ThinkTimes{.count = real_.count(),
                    .median = Micros{real_.at(0.5)},
                    .most = most_,
                    .most_at = most_at_,
                    .recorded_median = Micros{recorded_.at(0.5)},
                    .recorded_most = Micros{recorded_.max()}};
}

}  // namespace porttape
