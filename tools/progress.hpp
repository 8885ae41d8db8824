#pragma once

#include <chrono>
#include <cstdint>
#include <ostream>
#include <string>
#include <string_view>

#include "libport/base/time.hpp"

namespace porttape {

// Says on a terminal how far work is that takes over a second, in one line that goes away with this object.
// Elsewhere silent. Refers to the stream.
class Progress {
 public:
  // Only the program's own stderr is a terminal.
  Progress(std::ostream& err, std::string_view verb, std::uint64_t total_bytes);
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  ~Progress() { clear(); }

  // Bytes in all so far. Costs next to nothing.
  void at(std::uint64_t bytes) {
    if (bytes >= look_at_) look(bytes);
  }
  void clear();

 private:
  void look(std::uint64_t bytes);

  std::ostream& err_;
  std::string verb_;
  std::uint64_t total_;
  Instant begun_;
  Instant shown_at_;
  std::uint64_t look_at_;
  bool shown_ = false;
};

}  // namespace porttape
