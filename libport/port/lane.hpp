#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <optional>

#include "libport/base/bytes.hpp"
#include "libport/loop/timer.hpp"

namespace porttape {

// One direction of a line in which bytes are held back until they are due, and events keep their place among
// them. Nothing overtakes what was put sooner, whatever its own moment is. While the way on is closed, bytes
// wait and so do the events behind them, each as long as it says; then the bytes before it are given up.
// Whatever it calls may call back, and drop() all. Loop thread only.
class Lane {
 public:
  struct Way {
    std::function<bool()> open;                 // may bytes pass? Call run() or arm() when that has changed
    std::function<void(ByteView)> pass;         // on, what is due
    std::function<void(std::size_t)> given_up;  // so many bytes, before an event that waits no longer
    std::function<void()> less;                 // less is held than before
  };

  Lane(Loop& loop, Way way);

  [[nodiscard]] bool empty() const { return steps_.empty(); }
  [[nodiscard]] std::size_t bytes() const { return bytes_; }
  // When it will do something by itself.
  [[nodiscard]] std::optional<Instant> next_due() const { return timer_.due(); }

  // At once where nothing holds it back.
  void put(ByteView data, Instant due);
  // With nothing before it an event is told at once, also while the way is closed.
  void put(std::function<void()> event, Instant waits_until = Instant::max());
  // Does what is due.
  void run();
  // What is held now waits for its moment no longer, only for the way to be open.
  void let_go();
  // The same from the loop, when it is time.
  void arm();
  // The same until it is switched off: nothing put is held for its moment.
  void hurry(bool on);
  // Drops all bytes and gives how many; the events are told, now. `less` is not called.
  std::size_t drop();

 private:
  struct Step {
    Instant due;
    Bytes data;                   // to be passed on, or
    std::function<void()> event;  // to be told
    Instant waits_until;
  };

  Step take();
  [[nodiscard]] std::optional<Instant> due(bool open) const;
  void hold(Step step);

  Loop* loop_;
  Way way_;
  std::deque<Step> steps_;
  std::size_t bytes_ = 0;
  bool hurry_ = false;
  bool less_ = false;  // to be told
  Timer timer_;
};

}  // namespace porttape
