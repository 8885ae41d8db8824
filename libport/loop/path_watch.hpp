#pragma once

#include <functional>
#include <memory>
#include <string>

#include "libport/loop/file_events.hpp"
#include "libport/loop/timer.hpp"

namespace porttape {

// Calls back when something may have changed about a path: its folder changed (inotify), or a while has
// passed (with back-off to two seconds, for folders that are missing themselves, and where inotify is
// refused). The callback may destroy the watch. Loop thread only.
class PathWatch {
 public:
  PathWatch(Loop& loop, const std::string& path, std::function<void()> on_change);

 private:
  void on_timer();

  std::function<void()> on_change_;
  std::unique_ptr<FileEvents::Watch> watch_;
  Timer timer_;
  Nanos delay_;
};

}  // namespace porttape
