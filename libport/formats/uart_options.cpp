#include "libport/formats/uart_options.hpp"

#include <fmt/format.h>

#include "libport/base/printable.hpp"
#include "libport/base/whole_number.hpp"
#include "libport/line/line_settings_text.hpp"

namespace porttape {
namespace {

std::optional<Parity> parity_named(std::string_view name) {
  for (const Parity parity : {Parity::none, Parity::even, Parity::odd, Parity::mark, Parity::space}) {
    if (to_string(parity) == name) return parity;
  }
  return std::nullopt;
}

std::optional<unsigned> within(std::string_view text, unsigned least, unsigned most) {
  const auto number = whole_number<unsigned>(text);
  return number && *number >= least && *number <= most ? number : std::nullopt;
}

}  // namespace

Result<UartOptions> UartOptions::parse(std::string_view text) {
  UartOptions options;
  while (!text.empty()) {
    const std::size_t comma = std::min(text.find(','), text.size());
    const std::string_view part = text.substr(0, comma);
    text.remove_prefix(std::min(comma + 1, text.size()));
    const std::size_t equals = std::min(part.find('='), part.size());
    const std::string_view key = part.substr(0, equals);
    const std::string_view value = part.substr(std::min(equals + 1, part.size()));
    bool right = !value.empty();
    if (part == "invert") {
      options.inverted = right = true;
    } else if (key == "rx") {
      options.rx = value;
    } else if (key == "tx") {
      options.tx = value;
    } else if (key == "databits") {
      right = (options.line.data_bits = within(value, 5, 8)).has_value();
    } else if (key == "stopbits") {
      right = (options.line.stop_bits = within(value, 1, 2)).has_value();
    } else if (key == "parity") {
      right = (options.line.parity = parity_named(value)).has_value();
    } else {
      right = false;
    }
    if (!right)
      return usage_error(
          fmt::format("option 'device': {} is wrong; of a UART it is e.g. "
                      "rx=D0,tx=D1,databits=8,parity=none,stopbits=1,invert",
                      in_quotes(part)));
  }
  return options;
}

}  // namespace porttape
