#include "libport/replay/device_line.hpp"

#include <algorithm>
#include <variant>

namespace porttape {

void DeviceLine::on_event(const Event& event, bool played) {
  if (const auto* drain = std::get_if<event::Drain>(&event);
      drain != nullptr && played && drains_.size() < kMostDrains)
    drains_.push_back(drain->took);
  const auto* settings = std::get_if<event::Settings>(&event);
  if (settings == nullptr || !settings->by) {
    const bool beside_it = line_event_of(event) || std::holds_alternative<event::Mark>(event) ||
                           std::holds_alternative<event::Drain>(event);
    if (!beside_it) asked_.reset();
    return;
  }
  const SeenSettings& what = settings->line;
  line_ = what.over(line_);
  if (!played) before_ = line_;
  if (*settings->by == Side::driver) {
    asked_ = what;
    driver_first_ = driver_first_ || (played && !first_own_);
    return;
  }
  if (const auto asked = std::exchange(asked_, std::nullopt)) {
    if (answers_.size() < kMostAnswers) answers_.emplace_back(*asked, what);
  } else if (!played) {
    last_own_ = what;
  } else if (!first_own_) {
    first_own_ = what;
  }
}

std::optional<SeenSettings> DeviceLine::own() const {
  return first_own_ && !driver_first_ ? first_own_ : last_own_;
}

std::optional<SeenSettings> DeviceLine::taken_for(const LineSettings& asked) const {
  const auto answer =
      std::ranges::find_if(answers_, [&asked](const auto& each) { return each.first.over(asked) == asked; });
  return answer == answers_.end() ? std::nullopt : std::optional(answer->second);
}

}  // namespace porttape
