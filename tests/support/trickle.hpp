#pragma once

#include <chrono>
#include <string_view>
#include <thread>
#include <unistd.h>
#include <vector>

namespace porttape::test {

// A slow device: writes each part `pause` after the one before it, the first `pause` after its own beginning.
// All are written when it goes away.
class Trickle {
 public:
  Trickle(int fd, std::vector<std::string_view> parts, std::chrono::milliseconds pause)
      : thread_([fd, parts = std::move(parts), pause] {
          for (const std::string_view part : parts) {
            std::this_thread::sleep_for(pause);
            if (::write(fd, part.data(), part.size()) < 0) return;
          }
        }) {}
  Trickle(const Trickle&) = delete;
  Trickle& operator=(const Trickle&) = delete;
  ~Trickle() { thread_.join(); }

 private:
  std::thread thread_;
};

}  // namespace porttape::test
