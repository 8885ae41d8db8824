#pragma once

#include <algorithm>
#include <cstddef>
#include <deque>
#include <functional>
#include <utility>
#include <vector>

#include "libport/line/line_event.hpp"

namespace porttape {

// Events of one peer that wait until they can be told: in order. Of settings the last ones are kept, and all
// flushes as one; of very many others the older ones of a kind are left out, but no request: how each signal
// stands at a request and at the end is always there. A plain value.
class WaitingEvents {
 public:
  static constexpr std::size_t kMost = 256;  // behind the last question

  void put(const LineEvent& event) {
    if (const auto* flush = std::get_if<line::Flush>(&event)) return put_flush(*flush);
    if (std::holds_alternative<line::Settings>(event)) {
      std::erase_if(events_,
                    [](const LineEvent& each) { return std::holds_alternative<line::Settings>(each); });
    } else if (!is_request(event)) {
      drop_older(event);
    }
    events_.push_back(event);
  }

  // Those that `take` chooses, in order; they are not kept any more.
  template <class Take>
  std::vector<LineEvent> take(const Take& take) {
    std::vector<LineEvent> taken;
    std::deque<LineEvent> kept;
    for (LineEvent& event : events_) {
      if (take(event)) {
        taken.push_back(std::move(event));
      } else {
        kept.push_back(std::move(event));
      }
    }
    events_ = std::move(kept);
    return taken;
  }
  std::vector<LineEvent> take_all() {
    return take([](const LineEvent&) { return true; });
  }
  void clear() { events_.clear(); }

 private:
  void put_flush(const line::Flush& flush) {
    for (LineEvent& each : events_) {
      if (auto* const other = std::get_if<line::Flush>(&each)) {
        if (other->queue != flush.queue) other->queue = FlushQueue::both;
        return;
      }
    }
    events_.emplace_back(flush);
  }
  static bool is_request(const LineEvent& event) { return answer_without_device(event).has_value(); }
  static bool is_alike(const LineEvent& one, const LineEvent& other) {
    const auto* const signal = std::get_if<LineSignal>(&one);
    return one.index() == other.index() &&
           (signal == nullptr || signal->name == std::get<LineSignal>(other).name);
  }
  void drop_older(const LineEvent& event) {
    const auto is_question = [](const LineEvent& each) { return std::holds_alternative<line::Ask>(each); };
    const auto begin = std::find_if(events_.rbegin(), events_.rend(), is_question).base();
    if (std::count_if(begin, events_.end(), std::not_fn(is_request)) < static_cast<std::ptrdiff_t>(kMost))
      return;
    const auto older =
        std::find_if(begin, events_.end(), [&](const LineEvent& each) { return is_alike(event, each); });
    if (older != events_.end()) events_.erase(older);
  }

  std::deque<LineEvent> events_;
};

}  // namespace porttape
