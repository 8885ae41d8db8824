#pragma once

#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "libport/line/line_event.hpp"
#include "libport/loop/loop.hpp"

namespace porttape {

// The drains that wait until a socket has taken all. Their end is told from the loop, since the caller may be
// in the midst of closing the line, and not at all once this object is gone. Loop thread only.
class WaitingDrains {
 public:
  WaitingDrains(Loop& loop, std::function<void(const line::Sent&)> tell)
      : loop_(&loop), tell_(std::move(tell)) {}

  void add(const line::Drain& drain) { numbers_.push_back(drain.number); }
  void end() {
    for (const RequestNumber number : std::exchange(numbers_, {})) {
      loop_->post([this, number, alive = std::weak_ptr<int>(alive_)] {
        if (!alive.expired()) tell_({number});
      });
    }
  }

 private:
  Loop* loop_;
  std::function<void(const line::Sent&)> tell_;
  std::vector<RequestNumber> numbers_;
  std::shared_ptr<int> alive_ = std::make_shared<int>();
};

}  // namespace porttape
