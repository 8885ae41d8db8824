#include "libport/loop/timer_queue.hpp"

#include <cstddef>
#include <vector>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>

namespace porttape {

struct TimerQueue::Wait {
  boost::asio::steady_timer timer;
};

TimerQueue::TimerQueue(boost::asio::io_context& io, const Clock& clock)
    : io_(io), clock_(clock), wait_(new Wait{boost::asio::steady_timer(io)}) {}
TimerQueue::~TimerQueue() {
  // What goes with an entry may remove others.
  while (!entries_.empty()) entries_.extract(entries_.begin());
}

void TimerQueue::close() { wait_.reset(); }

TimerQueue::Place TimerQueue::put(Instant when, std::shared_ptr<Entry> entry) {
  const Place place{when, next_number_++};
  entries_.emplace(place, std::move(entry));
  arm();
  return place;
}

void TimerQueue::remove(const Place& place) {
  // While there are other entries the wait stays: one that ends early costs less than every change of it.
  if (const auto removed = entries_.extract(place); !removed.empty() && entries_.empty()) arm();
}

std::optional<Instant> TimerQueue::earliest() const {
  if (entries_.empty()) return std::nullopt;
  return entries_.begin()->first.first;
}

void TimerQueue::arm() {
  if (!wait_) return;
  if (entries_.empty()) {
    if (armed_) wait_->timer.cancel();
    armed_.reset();
    ++round_;
    return;
  }
  // Where somebody moves the clock, the wait only keeps the loop running until clock_moved().
  const Instant end = clock_.machine_time(entries_.begin()->first.first).value_or(Instant::max());
  if (armed_ && *armed_ <= end) return;
  armed_ = end;
  wait_->timer.expires_at(end);
  wait_->timer.async_wait([this, round = ++round_](const boost::system::error_code& error) {
    if (!error && round == round_) wake();
  });
}

void TimerQueue::wake() {
  struct ArmAtEnd {  // also when an entry throws
    TimerQueue* queue;
    ~ArmAtEnd() { queue->arm(); }
  };
  armed_.reset();
  const ArmAtEnd at_end{this};
  const Instant now = clock_.now();
  using Due = std::pair<const Place, std::shared_ptr<Entry>>;
  std::vector<Due> due;
  while (!entries_.empty() && entries_.begin()->first.first <= now) {
    due.emplace_back(entries_.begin()->first, std::move(entries_.begin()->second));
    entries_.erase(entries_.begin());
  }
  for (std::size_t other = 1; other < due.size(); ++other) {
    boost::asio::post(
        io_, [place = due[other].first, entry = std::move(due[other].second)] { entry->on_due(place); });
  }
  if (!due.empty()) due.front().second->on_due(due.front().first);
}

}  // namespace porttape
