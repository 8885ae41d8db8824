#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "libport/loop/backoff.hpp"
#include "libport/loop/file_events.hpp"
#include "libport/loop/timer.hpp"

namespace porttape {

// Waits for what a path leads to. Every folder on the way is watched, those of links too, so that the way may
// be missing from any point on, vanish and come back elsewhere: the callback comes when something that the
// way leads through has changed and it leads somewhere. While it does, the callback comes again after
// `first`, twice that, … 2 s: no event tells when what is there can be used. Where nothing is there no timer
// runs, except where inotify is refused. The callback may destroy the watch. Loop thread only.
class PathWatch {
 public:
  static constexpr Nanos kFirst = std::chrono::milliseconds(100);
  static constexpr Nanos kLongest = std::chrono::seconds(2);

  PathWatch(Loop& loop, const std::string& path, std::function<void()> on_change, Nanos first = kFirst);

  // Whether it looks by the clock too.
  [[nodiscard]] bool has_timer() const { return timer_.due().has_value(); }

 private:
  using Watches = std::vector<std::unique_ptr<FileEvents::Watch>>;

  void walk();
  [[nodiscard]] bool follow(Watches& watches);
  void watch_again();
  void on_event();
  void look();

  Loop* loop_;
  std::string path_;
  std::function<void()> on_change_;
  Timer timer_;
  Backoff wait_;
  Watches watches_;     // of the folders on the way, as far as there are any
  bool leads_ = false;  // to something
};

}  // namespace porttape
