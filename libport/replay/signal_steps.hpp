#pragma once

#include <algorithm>
#include <cstddef>
#include <deque>
#include <optional>
#include <set>

#include "libport/base/time.hpp"
#include "libport/line/line_signal.hpp"

namespace porttape {

// What the driver did to the signals of its line, and the walk has not come to yet; and which of the
// device's the walk has passed in this session. Bounded. A plain value.
class SignalSteps {
 public:
  // What the driver did before it belongs to none that comes.
  void begin_session(Instant now) {
    told_.clear();
    std::erase_if(made_, [now](const Made& made) { return made.at < now; });
  }
  void forget() { made_.clear(); }

  void made(Instant now, const LineSignal& signal) {
    if (made_.size() == kMost) made_.pop_front();
    made_.push_back({now, signal});
  }
  // When the driver did this: what it did before is passed. Nothing: it did not yet.
  std::optional<Instant> take(const LineSignal& signal) {
    const auto found = std::ranges::find(made_, signal, &Made::signal);
    if (found == made_.end()) return std::nullopt;
    const Instant when = found->at;
    made_.erase(made_.begin(), found + 1);
    return when;
  }

  // Of the device's, in this session.
  [[nodiscard]] bool told(LineSignal::Name name) const { return told_.contains(name); }
  void tell(LineSignal::Name name) { told_.insert(name); }

 private:
  static constexpr std::size_t kMost = 256;
  struct Made {
    Instant at{};
    LineSignal signal;
  };
  std::deque<Made> made_;
  std::set<LineSignal::Name> told_;
};

}  // namespace porttape
