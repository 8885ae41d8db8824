#include "libport/supervise/line_model.hpp"

#include <array>
#include <fmt/format.h>
#include <sys/ioctl.h>
#include <utility>

#include "libport/base/printable.hpp"

namespace porttape {
namespace {

constexpr std::string_view kLinesAccepted =
    "accepted: on, off, loopback, or some of cts=, dsr=, cd= and ri= with on or off";

Error wrong_lines(std::string_view text) {
  return make_error(Errc::usage, fmt::format("modem lines {}: {}", in_quotes(text), kLinesAccepted));
}

}  // namespace

Result<LineDefaults> parse_line_defaults(std::string_view text) {
  LineDefaults lines;
  if (text == "on") return lines;
  if (text == "off") return LineDefaults{.cts = false, .dsr = false, .cd = false};
  if (text == "loopback") return LineDefaults{.cts = false, .dsr = false, .cd = false, .loopback = true};
  const std::array<std::pair<std::string_view, bool*>, 4> names{
      {{"cts", &lines.cts}, {"dsr", &lines.dsr}, {"cd", &lines.cd}, {"ri", &lines.ri}}};
  for (std::string_view rest = text;;) {
    const std::size_t comma = rest.find(',');
    const std::string_view one = rest.substr(0, comma);
    const std::size_t equals = one.find('=');
    bool* line = nullptr;
    for (const auto& [name, place] : names) {
      if (name == one.substr(0, equals)) line = place;
    }
    const std::string_view state = equals == std::string_view::npos ? "" : one.substr(equals + 1);
    if (line == nullptr || (state != "on" && state != "off")) return wrong_lines(text);
    *line = state == "on";
    if (comma == std::string_view::npos) return lines;
    rest.remove_prefix(comma + 1);
  }
}

LineModel::LineModel(const LineDefaults& defaults)
    : cts_(defaults.cts),
      dsr_(defaults.dsr),
      cd_(defaults.cd),
      ri_(defaults.ri),
      loopback_(defaults.loopback) {}

void LineModel::opened() {
  (void)drive(LineSignal::Name::dtr, true);
  (void)drive(LineSignal::Name::rts, true);
}

void LineModel::closed() {
  (void)drive(LineSignal::Name::dtr, false);
  (void)drive(LineSignal::Name::rts, false);
}

bool LineModel::drive(LineSignal::Name name, bool on) {
  bool& line = name == LineSignal::Name::dtr ? dtr_ : rts_;
  const bool changed = std::exchange(line, on) != on;
  if (changed && loopback_) loop_back();
  return changed;
}

void LineModel::loop_back() {
  set_input(LineSignal::Name::cts, rts_);
  set_input(LineSignal::Name::dsr, dtr_);
  set_input(LineSignal::Name::cd, dtr_);
}

void LineModel::show(const LineSignal& signal) {
  loopback_ = false;
  set_input(signal.name, signal.on);
}

void LineModel::set_input(LineSignal::Name name, bool on) {
  const auto change = [on](bool& line, int& count) {
    if (std::exchange(line, on) != on) ++count;
  };
  switch (name) {
    case LineSignal::Name::cts:
      return change(cts_, counters_.cts);
    case LineSignal::Name::dsr:
      return change(dsr_, counters_.dsr);
    case LineSignal::Name::cd:
      return change(cd_, counters_.cd);
    case LineSignal::Name::ri:
      if (std::exchange(ri_, on) && !on) ++counters_.ri;
      return;
    case LineSignal::Name::brk:
      if (on) ++counters_.breaks;
      return;
    case LineSignal::Name::dtr:
    case LineSignal::Name::rts:
      return;
  }
}

int LineModel::bits() const {
  return (dtr_ ? TIOCM_DTR : 0) | (rts_ ? TIOCM_RTS : 0) | (cts_ ? TIOCM_CTS : 0) | (dsr_ ? TIOCM_DSR : 0) |
         (cd_ ? TIOCM_CD : 0) | (ri_ ? TIOCM_RI : 0);
}

}  // namespace porttape
