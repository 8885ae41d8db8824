#include "libport/tape/line_state.hpp"

#include <optional>
#include <variant>

namespace porttape {
namespace {

// What there is one of at a time, in the order in which it is told.
enum Held : int {
  held_open,
  held_by_device,
  held_settings,
  held_by_driver,
  held_lost,
  held_end,
  held_signal = held_end + 2
};

int signal_held(const TapedSignal& signal) {
  return held_signal + 2 * static_cast<int>(signal.signal.name) + (signal.by == Side::device ? 1 : 0);
}

int settings_held(const event::Settings& settings) {
  if (!settings.by) return held_settings;
  return *settings.by == Side::device ? held_by_device : held_by_driver;
}

std::optional<int> held_of(const Event& event) {
  if (std::holds_alternative<event::Open>(event)) return held_open;
  if (std::holds_alternative<event::DeviceLost>(event)) return held_lost;
  if (const auto* settings = std::get_if<event::Settings>(&event)) return settings_held(*settings);
  if (const auto* ended = std::get_if<event::HalfClose>(&event))
    return held_end + (ended->by == Side::device ? 1 : 0);
  if (const auto signal = signal_of(event)) return signal_held(*signal);
  return std::nullopt;
}

// A break that has ended is as if there had been none.
bool is_over(const Event& event) {
  const auto signal = signal_of(event);
  return signal && signal->signal.name == LineSignal::Name::brk && !signal->signal.on;
}

}  // namespace

// Behind an open stand the signals as they are then, and the driver's settings.
void LineState::on_open(std::string_view line) {
  end_session();
  lines_[held_open] = line;
}

void LineState::end_session() {
  std::erase_if(lines_,
                [](const auto& held) { return held.first != held_by_device && held.first != held_settings; });
}

void LineState::pass(const Record& record) {
  if (record.event == nullptr) return;
  const Event& event = *record.event;
  if (std::holds_alternative<event::Open>(event)) return on_open(record.event_line);
  if (std::holds_alternative<event::Close>(event)) return end_session();
  if (std::holds_alternative<event::DeviceBack>(event)) {
    lines_.erase(held_lost);
    return;
  }
  const auto held = held_of(event);
  if (held && is_over(event)) {
    lines_.erase(*held);
  } else if (held) {
    lines_[*held] = record.event_line;
  }
}

bool LineState::holds(const Record& record) const {
  const auto held = record.event == nullptr ? std::nullopt : held_of(*record.event);
  const auto told = held ? lines_.find(*held) : lines_.end();
  return told != lines_.end() &&
         encode_carried(told->second, TapeTime{}) == encode_carried(record.event_line, TapeTime{});
}

std::vector<std::string> LineState::lines() const {
  std::vector<std::string> lines;
  for (const auto& [held, line] : lines_) lines.push_back(line);
  return lines;
}

}  // namespace porttape
