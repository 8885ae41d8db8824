#include <string>

#include "libport/port/port_options.hpp"

namespace porttape {

using Kind = OptionSpec::Kind;

std::vector<OptionSpec> line_setting_options() {
  constexpr double most_baud = 4'294'967'295.0;  // termios2 keeps speeds in 32 bits
  return {{.name = "baud",
           .kind = Kind::integer,
           .default_value = "9600",
           .help = "speed in bit/s, any that the kernel takes",
           .min = 1,
           .max = most_baud,
           .value_name = "RATE"},
          {"parity", Kind::choice, "none", "parity bit", 0, 0, {"none", "even", "odd"}},
          {"databits", Kind::integer, "8", "bits of a character", 5, 8},
          {"stopbits", Kind::integer, "1", "bits behind a character", 1, 2},
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

}  // namespace porttape
