#include "libport/replay/line_view.hpp"

#include <array>
#include <string_view>
#include <utility>

#include "libport/line/line_settings_text.hpp"

namespace porttape {
namespace {

using NamedSignal = std::pair<std::string_view, const std::optional<bool>*>;

std::array<NamedSignal, 3> signals_of(const LineView& line) {
  return {{{"dtr", &line.dtr}, {"rts", &line.rts}, {"break", &line.brk}}};
}

}  // namespace

LineView LineView::of(const LineSignal& signal) {
  LineView line;
  if (signal.name == LineSignal::Name::dtr) line.dtr = signal.on;
  if (signal.name == LineSignal::Name::rts) line.rts = signal.on;
  if (signal.name == LineSignal::Name::brk) line.brk = signal.on;
  return line;
}

std::string to_text(const LineView& line) {
  std::string text;
  if (line.settings != SeenSettings()) text = to_text(line.settings);
  for (const auto& [name, state] : signals_of(line)) {
    if (!*state) continue;
    if (!text.empty()) text += ", ";
    text += std::string(name) + (**state ? " on" : " off");
  }
  return text.empty() ? to_text(line.settings) : text;
}

void add_line(JsonObject& object, const LineView& line) {
  add_settings(object, line.settings);
  for (const auto& [name, state] : signals_of(line)) {
    if (*state) object.add(name, **state ? "on" : "off");
  }
}

}  // namespace porttape
