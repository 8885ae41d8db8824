#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "libport/line/line_signal.hpp"

namespace porttape {

// Signals that wait to be told, in their order. Of very many the older changes are left out: how each signal
// stands at the end is always there. A plain value.
class SignalQueue {
 public:
  static constexpr std::size_t kMost = 256;

  void put(const LineSignal& signal) {
    if (signals_.size() >= kMost) {
      const auto older = std::ranges::find(signals_, signal.name, &LineSignal::name);
      if (older != signals_.end()) signals_.erase(older);
    }
    signals_.push_back(signal);
  }
  // All, and has none then.
  std::vector<LineSignal> take() { return std::exchange(signals_, {}); }
  void clear() { signals_.clear(); }

 private:
  std::vector<LineSignal> signals_;
};

}  // namespace porttape
