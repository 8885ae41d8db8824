#include "libport/port/path_watch.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <sys/inotify.h>
#include <unistd.h>
#include <utility>

namespace porttape {
namespace {

constexpr Nanos kFirstDelay = std::chrono::milliseconds(100);
constexpr Nanos kLongestDelay = std::chrono::seconds(2);

}  // namespace

PathWatch::PathWatch(Loop& loop, const std::string& path, std::function<void()> on_change)
    : on_change_(std::move(on_change)),
      inotify_(::inotify_init1(IN_NONBLOCK | IN_CLOEXEC)),
      watch_(loop, inotify_.get(), [this] { drain(); }),
      timer_(loop, [this] { on_timer(); }),
      delay_(kFirstDelay) {
  const std::filesystem::path folder = std::filesystem::absolute(path).parent_path();
  // IN_ATTRIB: udev gives a new node its permissions after making it.
  ::inotify_add_watch(inotify_.get(), folder.c_str(), IN_CREATE | IN_MOVED_TO | IN_ATTRIB | IN_ONLYDIR);
  watch_.watch_readable(true);
  timer_.set_after(delay_);
}

void PathWatch::drain() {
  std::array<char, 4096> buffer{};
  while (::read(inotify_.get(), buffer.data(), buffer.size()) > 0) {
  }
  on_change_();
}

void PathWatch::on_timer() {
  delay_ = std::min(delay_ * 2, kLongestDelay);
  timer_.set_after(delay_);
  on_change_();
}

}  // namespace porttape
