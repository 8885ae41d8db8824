#pragma once

#include <functional>
#include <utility>

namespace porttape {

// A tty that a test plays by the ioctls that come to it. This program's ioctl() (serial_rate_test.cpp) asks
// it for kFd as long as it lives, on the thread that made it.
class PlayedTty {
 public:
  static constexpr int kFd = -7;  // no descriptor

  // What ioctl() returns for a request; it sets errno itself.
  using Play = std::function<int(unsigned long request, void* argument)>;

  explicit PlayedTty(Play play) : play_(std::move(play)) { current() = &play_; }
  ~PlayedTty() { current() = nullptr; }
  PlayedTty(const PlayedTty&) = delete;
  PlayedTty& operator=(const PlayedTty&) = delete;

  static const Play*& current() {
    static thread_local const Play* play = nullptr;
    return play;
  }

 private:
  Play play_;
};

}  // namespace porttape
