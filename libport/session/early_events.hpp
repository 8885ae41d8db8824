#pragma once

#include <algorithm>
#include <cstddef>
#include <deque>
#include <utility>
#include <vector>

#include "libport/line/line_event.hpp"

namespace porttape {

// What a driver did to its line while its device is being opened: in order, until the device takes it. Of
// settings the last ones are kept, and all flushes as one; of very many signals the older changes are left
// out: how each signal stands at a request and at the end is always there. A plain value.
class EarlyEvents {
 public:
  static constexpr std::size_t kMostSignals = 256;  // behind the last request

  void put(const LineEvent& event) {
    if (const auto* flush = std::get_if<line::Flush>(&event)) return put_flush(*flush);
    if (const auto* signal = std::get_if<LineSignal>(&event)) drop_older(*signal);
    if (std::holds_alternative<line::Settings>(event))
      std::erase_if(events_,
                    [](const LineEvent& each) { return std::holds_alternative<line::Settings>(each); });
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
  void drop_older(const LineSignal& signal) {
    const auto is_request = [](const LineEvent& each) { return std::holds_alternative<line::Ask>(each); };
    const auto is_signal = [](const LineEvent& each) { return std::holds_alternative<LineSignal>(each); };
    const auto begin = std::find_if(events_.rbegin(), events_.rend(), is_request).base();
    if (std::count_if(begin, events_.end(), is_signal) < static_cast<std::ptrdiff_t>(kMostSignals)) return;
    const auto older = std::find_if(begin, events_.end(), [&signal](const LineEvent& each) {
      const auto* const other = std::get_if<LineSignal>(&each);
      return other != nullptr && other->name == signal.name;
    });
    if (older != events_.end()) events_.erase(older);
  }

  std::deque<LineEvent> events_;
};

}  // namespace porttape
