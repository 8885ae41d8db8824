#include "libport/loop/path_watch.hpp"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <utility>

namespace porttape {
namespace {

constexpr Nanos kFirstDelay = std::chrono::milliseconds(100);
constexpr Nanos kLongestDelay = std::chrono::seconds(2);

}  // namespace

PathWatch::PathWatch(Loop& loop, const std::string& path, std::function<void()> on_change)
    : on_change_(std::move(on_change)),
      watch_(loop.file_events().watch_folder(std::filesystem::absolute(path).parent_path().string())),
      timer_(loop, [this] { on_timer(); }),
      delay_(kFirstDelay) {
  watch_->on_event([this] {
    (void)watch_->take();
    on_change_();
  });
  timer_.set_after(delay_);
}

void PathWatch::on_timer() {
  delay_ = std::min(delay_ * 2, kLongestDelay);
  timer_.set_after(delay_);
  on_change_();
}

}  // namespace porttape
