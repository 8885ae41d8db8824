#include "tools/text.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <fmt/format.h>

#include "libport/line/line_settings_text.hpp"

namespace porttape {
namespace {

std::string with_unit(double value, const char* unit) {
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), value < 9.995 ? "%.2f %s" : "%.1f %s", value, unit);
  return text.data();
}

std::string_view who_signals(const TapedSignal& taped) {
  return taped.by == Side::driver ? "driver" : "device";
}

}  // namespace

std::string seconds_number(std::int64_t us) {
  std::string fraction = std::to_string(us % 1'000'000);
  fraction.insert(0, 6 - fraction.size(), '0');
  return std::to_string(us / 1'000'000) + '.' + fraction;
}

std::optional<TapeTime> parse_seconds(std::string_view text) {
  double seconds = 0;
  const auto [end, error] =
      std::from_chars(text.data(), text.data() + text.size(), seconds, std::chars_format::fixed);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  if (!(seconds >= 0) || seconds > 1e10) return std::nullopt;
  return tape_time_us(std::llround(seconds * 1e6));
}

std::string span_text(std::int64_t us) {
  if (us < 1000) return std::to_string(us) + " us";
  if (us < 1'000'000) return with_unit(static_cast<double>(us) / 1e3, "ms");
  return with_unit(static_cast<double>(us) / 1e6, "s");
}

std::string rate_text(std::uint64_t bytes, std::int64_t us) {
  if (us <= 0) return "-";
  const double rate = static_cast<double>(bytes) * 1e6 / static_cast<double>(us);
  if (rate < 1e3) return with_unit(rate, "B/s");
  if (rate < 1e6) return with_unit(rate / 1e3, "kB/s");
  return with_unit(rate / 1e6, "MB/s");
}

std::string settings_text(const event::Settings& settings) {
  const bool sampled = settings.order == SettingsOrder::sampled;
  const std::string_view who = !settings.by ? "line" : *settings.by == Side::driver ? "driver" : "device";
  return std::string(who) + ": " + to_text(settings.line) + (sampled ? " (sampled)" : "");
}

std::string signal_text(const TapedSignal& taped) {
  if (taped.signal.name != LineSignal::Name::brk) return named_signal_text(taped);
  return fmt::format("{}: {}", who_signals(taped), taped.signal.on ? "on" : "off");
}

std::string named_signal_text(const TapedSignal& taped) {
  return fmt::format("{}: {} {}", who_signals(taped), name_of(taped.signal.name),
                     taped.signal.on ? "on" : "off");
}

}  // namespace porttape
