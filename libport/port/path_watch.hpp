#pragma once

#include <functional>
#include <string>

#include "libport/base/unique_fd.hpp"
#include "libport/port/fd_watch.hpp"
#include "libport/port/timer.hpp"

namespace porttape {

// Calls back when something may have changed about a path: its folder changed (inotify), or a while has
// passed (with back-off to two seconds, for folders that are missing themselves). The callback may destroy
// the watch. Loop thread only.
class PathWatch {
 public:
  PathWatch(Loop& loop, const std::string& path, std::function<void()> on_change);

 private:
  void drain();
  void on_timer();

  std::function<void()> on_change_;
  UniqueFd inotify_;
  FdWatch watch_;
  Timer timer_;
  Nanos delay_;
};

}  // namespace porttape
