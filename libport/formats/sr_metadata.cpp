#include "libport/formats/sr_metadata.hpp"

#include <algorithm>
#include <cctype>
#include <fmt/format.h>
#include <strings.h>

#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"

namespace porttape {
namespace {

constexpr unsigned kMostChannels = 64;
constexpr std::uint64_t kFastest = 1'000'000'000'000;

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.front())) != 0) text.remove_prefix(1);
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back())) != 0) text.remove_suffix(1);
  return text;
}

// "1 MHz", "921600 Hz", "1.5 MHz"; 0: it is none.
std::uint64_t rate_of(std::string_view text) {
  const std::size_t digits = std::min(text.find_first_not_of("0123456789."), text.size());
  double number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + digits, number);
  if (error != std::errc() || end != text.data() + digits) return 0;
  std::string_view unit = trimmed(text.substr(digits));
  if (unit.ends_with("Hz")) unit.remove_suffix(2);
  for (const auto& [prefix, factor] : {std::pair("k", 1e3), {"K", 1e3}, {"M", 1e6}, {"G", 1e9}}) {
    if (unit == prefix) number *= factor;
    if (unit == prefix) unit = {};
  }
  return unit.empty() && number >= 1 && number <= static_cast<double>(kFastest)
             ? static_cast<std::uint64_t>(number)
             : 0;
}

}  // namespace

Result<SrMetadata> SrMetadata::parse(std::string_view text) {
  SrMetadata all;
  std::string ours;
  std::string section;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = trimmed(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
    if (line.starts_with('[') && line.ends_with(']')) section = line.substr(1, line.size() - 2);
    const std::size_t equals = line.find('=');
    if (equals == std::string_view::npos) continue;
    const std::string_view key = trimmed(line.substr(0, equals));
    const std::string_view value = trimmed(line.substr(equals + 1));
    if (section == "porttape" && key == "lead") {
      all.lead = whole_number<std::uint64_t>(value).value_or(0);
    } else if (section == "porttape" && key == "baud") {
      all.line.baud = whole_number<unsigned>(value);
    } else if (section == "porttape") {
      ours += fmt::format("{}{}={}", ours.empty() ? "" : ",", key, value);
    } else if (!section.starts_with("device ")) {
      continue;
    } else if (key == "capturefile") {
      if (all.capture.empty()) all.capture = value;
    } else if (key == "samplerate") {
      all.rate = rate_of(value);
    } else if (key == "unitsize") {
      all.unit_size = whole_number<unsigned>(value).value_or(0);
    } else if (key.starts_with("probe")) {
      const auto number = whole_number<unsigned>(key.substr(5));
      if (!number || *number == 0 || *number > kMostChannels) continue;
      if (all.channels.size() < *number) all.channels.resize(*number);
      all.channels[*number - 1] = value;
    }
  }
  if (const auto line = UartOptions::parse(ours)) all.line = all.line.over(line->line);
  const auto wrong = [](const char* what) {
    return make_error(Errc::damaged_tape, std::string("the session's metadata tells no ") + what);
  };
  if (all.capture.empty()) return wrong("file of logic samples");
  if (all.rate == 0) return wrong("rate of its samples");
  if (all.unit_size == 0 || all.unit_size > kMostChannels / 8) return wrong("sensible size of a sample");
  if (all.channels.empty()) return wrong("channels");
  return all;
}

std::optional<unsigned> SrMetadata::channel(std::string_view name) const {
  const auto found = std::ranges::find_if(channels, [&](const std::string& each) {
    return each.size() == name.size() && ::strncasecmp(each.data(), name.data(), name.size()) == 0;
  });
  if (name.empty() || found == channels.end()) return std::nullopt;
  const auto number = static_cast<unsigned>(found - channels.begin());
  return number < unit_size * 8 ? std::optional(number) : std::nullopt;
}

}  // namespace porttape
