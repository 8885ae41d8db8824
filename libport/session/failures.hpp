#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "libport/base/time.hpp"
#include "libport/loop/backoff.hpp"

namespace porttape {

// The failures of a line in a row, so that a driver that opens its port again and again (or a device that
// dies as soon as it is opened) fills no log and keeps no processor busy: each trouble is news once, and the
// line is opened again the later the more often it has failed in quick succession. The row ends when the line
// has worked: a byte came, its driver has closed it, or it was up for kLineHeld. Time is an argument.
class Failures {
 public:
  static constexpr Nanos kFirstWait = std::chrono::milliseconds(10);
  static constexpr Nanos kLongestWait = std::chrono::seconds(1);

  // The line has come up.
  void up(Instant now) { up_since_ = now; }
  // It could not be opened, or was lost. True: that was not told yet in this row.
  bool failed(Instant now, const std::string& what);
  void worked();
  [[nodiscard]] bool in_a_row() const { return !told_.empty(); }
  // One of them was told before.
  [[nodiscard]] bool repeats() const { return untold_ > 0; }

  // When it may be opened; in the past where nothing speaks against now.
  [[nodiscard]] Instant may_open() const { return may_open_; }

  // How many failures were not told in the rows that are over: once.
  [[nodiscard]] std::optional<std::uint64_t> take_untold();

 private:
  static constexpr std::size_t kMostTold = 8;

  std::vector<std::string> told_;  // of this row
  std::uint64_t untold_ = 0;       // in this row
  std::uint64_t over_ = 0;         // in rows that are over
  std::optional<Instant> up_since_;
  Instant may_open_{};
  Backoff wait_{kFirstWait, kLongestWait};
};

}  // namespace porttape
