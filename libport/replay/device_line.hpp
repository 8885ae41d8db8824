#pragma once

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "libport/base/time.hpp"
#include "libport/line/line_settings.hpp"
#include "libport/tape/event.hpp"

namespace porttape {

// The device's line by what a tape tells of it: how it is when the line comes up, and what it makes of what
// the driver asks for. A plain value of bounded size; told the tape's events in order.
class DeviceLine {
 public:
  // `played`: it belongs to what is played of the tape.
  void on_event(const Event& event, bool played);

  // Before the first event that is played; what is not known is absent.
  [[nodiscard]] const SeenSettings& before() const { return before_; }
  // When it comes up in what is played; nothing where the tape tells of none.
  [[nodiscard]] std::optional<SeenSettings> own() const;
  // What it takes instead of `asked`, as it did on the tape. That may be what it had before: it refused.
  [[nodiscard]] std::optional<SeenSettings> taken_for(const LineSettings& asked) const;
  // How long each drain of the driver's took in what is played, in order; the first of very many.
  [[nodiscard]] const std::vector<Micros>& drains() const { return drains_; }

 private:
  static constexpr std::size_t kMostAnswers = 64;
  static constexpr std::size_t kMostDrains = 65536;

  SeenSettings line_;  // so far
  SeenSettings before_;
  std::optional<SeenSettings> last_own_;   // the device's before what is played
  std::optional<SeenSettings> first_own_;  // and the first in it
  bool driver_first_ = false;              // in it the driver's came before the device's
  std::optional<SeenSettings> asked_;      // by the driver, and not answered
  std::vector<std::pair<SeenSettings, SeenSettings>> answers_;
  std::vector<Micros> drains_;
};

}  // namespace porttape
