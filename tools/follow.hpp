#pragma once

#include <optional>
#include <string>

#include "libport/base/time.hpp"
#include "libport/base/unique_fd.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// Waits for a tape that is being written to grow: by inotify, and where that is refused by looking at it
// again.
class TapeGrowth {
 public:
  // For so long it waits at most.
  static constexpr std::chrono::seconds kQuiet{1};
  // What is written together (a batch for a slow disk) comes within this time.
  static constexpr std::chrono::milliseconds kSettle{20};

  // `out`: the descriptor that is written to, or -1.
  TapeGrowth(const TapePaths& tape, int out);

  enum class News {
    grown,     // or may have
    quiet,     // nothing came for kQuiet
    no_reader  // of `out`
  };
  News wait() const;

 private:
  UniqueFd inotify_;
  int out_;
};

// The tape that goes on where this one ends (rotation): its header names this one. Waits so long for it.
std::optional<std::string> next_part(const TapePaths& tape, const std::string& id, Nanos limit);

}  // namespace porttape
