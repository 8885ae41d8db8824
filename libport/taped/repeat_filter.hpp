#pragma once

#include <chrono>
#include <optional>

#include "libport/base/time.hpp"
#include "libport/line/line_settings.hpp"
#include "libport/port/port.hpp"
#include "libport/tape/event.hpp"

namespace porttape {

// Tells what is worth a line on the tape from what only says again how things are, so that a driver that sets
// or flushes its line without end costs nothing. A plain value; told all of a line in order.
class RepeatFilter {
 public:
  // A flush that comes so soon after another one, with no byte between them, drops nothing more.
  static constexpr std::chrono::milliseconds kFlushes{10};

  // A driver opens: its first settings are news whatever the last one's were.
  void begin_session();
  void on_bytes();

  // Of settings and flushes as below; all others are new.
  bool is_new(const TapedLineEvent& event, Instant now);
  // Whether it is not as `by` had it already, or the other side had changed it since. Then that is how it is
  // from now on.
  bool is_new(Side by, const SeenSettings& settings);
  bool is_new(FlushQueue queue, Instant now);

 private:
  std::optional<SeenSettings> device_;  // the last of each
  std::optional<SeenSettings> driver_;
  SeenSettings line_;                // what both have made of it
  std::optional<Instant> in_since_;  // flushed then, and nothing has passed since
  std::optional<Instant> out_since_;
};

}  // namespace porttape
