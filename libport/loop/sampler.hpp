#pragma once

#include <functional>
#include <map>
#include <memory>

#include "libport/loop/timer.hpp"

namespace porttape {

// Looks again and again at what no event tells of (a pty's settings), for all ports of a loop by one timer:
// quickly in the first second, since drivers set their line just after opening it, slowly while something
// happens on the line, and rarely else, so that idle lines cost nothing. Loop thread only.
class Sampler {
 public:
  static constexpr Nanos kQuick = std::chrono::milliseconds(5);
  static constexpr Nanos kSlow = std::chrono::milliseconds(100);
  static constexpr Nanos kRarely = std::chrono::milliseconds(600);
  static constexpr Nanos kYoung = std::chrono::seconds(1);   // after add()
  static constexpr Nanos kActive = std::chrono::seconds(2);  // after touch()

  explicit Sampler(Loop& loop);

  // `look` is called until remove(); it may add and remove. Adding an owner again makes it young again.
  void add(const void* owner, std::function<void()> look);
  void remove(const void* owner);
  // Something happens on the owner's line.
  void touch(const void* owner);

 private:
  struct Member {
    std::function<void()> look;
    std::shared_ptr<Fence> fence;
    Instant young_until;
    Instant active_until;
    bool removed = false;
  };

  void on_timer();
  void look_within(Nanos time);

  Loop* loop_;
  std::map<const void*, std::shared_ptr<Member>> members_;
  Instant next_slow_{};
  Instant next_rare_{};
  Timer timer_;
};

}  // namespace porttape
