#include "libport/port/line_settings.hpp"

#include <string>

#include "libport/port/port_options.hpp"

namespace porttape {

using Kind = OptionSpec::Kind;

std::vector<OptionSpec> line_setting_options() {
  constexpr double most_baud = 4'294'967'295.0;  // termios2 keeps speeds in 32 bits
  return {{"baud", Kind::integer, "9600", "bit/s, any rate the kernel takes", 1, most_baud},
          {"parity", Kind::choice, "none", "none, even or odd", 0, 0, {"none", "even", "odd"}},
          {"databits", Kind::integer, "8", "5 to 8", 5, 8},
          {"stopbits", Kind::integer, "1", "1 or 2", 1, 2},
          {"hwflowctrl", Kind::flag, "", "RTS/CTS flow control"},
          {"swflowctrl", Kind::flag, "", "XON/XOFF flow control"}};
}

LineSettings line_settings(const PortOptions& written) {
  const std::string parity = written.text("parity");
  return {.baud = static_cast<unsigned>(written.integer("baud")),
          .data_bits = static_cast<unsigned>(written.integer("databits")),
          .parity = parity == "even"  ? Parity::even
                    : parity == "odd" ? Parity::odd
                                      : Parity::none,
          .stop_bits = static_cast<unsigned>(written.integer("stopbits")),
          .hw_flow = written.flag("hwflowctrl"),
          .sw_flow = written.flag("swflowctrl")};
}

LineSettings SeenSettings::over(const LineSettings& others) const {
  return {.baud = baud,
          .data_bits = data_bits.value_or(others.data_bits),
          .parity = parity.value_or(others.parity),
          .stop_bits = stop_bits,
          .hw_flow = hw_flow,
          .sw_flow = sw_flow};
}

}  // namespace porttape
