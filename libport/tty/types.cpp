#include "libport/tty/types.hpp"

#include <memory>
#include <optional>
#include <string>

#include "libport/port/port_options.hpp"
#include "libport/tty/pty_port.hpp"
#include "libport/tty/serial_port.hpp"

namespace porttape {
namespace {

using Kind = OptionSpec::Kind;

constexpr double kMaxBaud = 4'294'967'295.0;  // termios2 keeps speeds in 32 bits

LineSettings settings_of(const PortOptions& written) {
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

std::optional<bool> on_or_off(const PortOptions& written, const std::string& option) {
  return written.has(option) ? std::optional(written.text(option) == "on") : std::nullopt;
}

Result<SerialOptions> serial_options(const PortOptions& written) {
  return SerialOptions{.device = written.text("device"),
                       .settings = settings_of(written),
                       .dtr = on_or_off(written, "dtr"),
                       .rts = on_or_off(written, "rts"),
                       .wait = written.flag("wait")};
}

Result<PtyOptions> pty_options(const PortOptions& written) {
  const Result<unsigned> mode = written.mode("mode");
  if (!mode) return mode.error();
  return PtyOptions{.link = written.text("link"),
                    .access = {*mode, written.text("owner"), written.text("group")}};
}

}  // namespace

PortType serial_type() {
  PortType type{"serial", {"device"}, "a serial device"};
  type.recorded_as = "seriallog";
  type.options = with_common({
      {"device", Kind::text, "/dev/ttyS0", "the tty"},
      {"baud", Kind::integer, "9600", "bit/s, any rate the kernel takes", 1, kMaxBaud},
      {"parity", Kind::choice, "none", "none, even or odd", 0, 0, {"none", "even", "odd"}},
      {"databits", Kind::integer, "8", "5 to 8", 5, 8},
      {"stopbits", Kind::integer, "1", "1 or 2", 1, 2},
      {"hwflowctrl", Kind::flag, "", "RTS/CTS flow control"},
      {"swflowctrl", Kind::flag, "", "XON/XOFF flow control"},
      {"dtr", Kind::choice, "", "sets DTR after opening", 0, 0, {"on", "off"}},
      {"rts", Kind::choice, "", "sets RTS after opening", 0, 0, {"on", "off"}},
      {"wait", Kind::flag, "", "a device that is missing is waited for"},
  });
  type.read = reads(serial_options);
  type.make = makes<SerialOptions>([](const auto& context, const auto& common, const auto& options) {
    return std::make_unique<SerialPort>(context, common, options);
  });
  return type;
}

PortType pty_type() {
  PortType type{"pty", {"link"}, "a pseudo-terminal that the peer opens"};
  type.recorded_as = "ptylog";
  type.options = with_common({
      {"link", Kind::text, "", "symbolic link to the slave; without it the slave's path is printed"},
      {"mode", Kind::text, "0600", "permissions of the slave, octal"},
      {"owner", Kind::text, "", "owner of the slave, name or number"},
      {"group", Kind::text, "", "group of the slave, name or number"},
  });
  type.read = reads(pty_options);
  type.make = makes<PtyOptions>([](const auto& context, const auto&, const auto& options) {
    return std::make_unique<PtyPort>(context, options);
  });
  type.claims = [](const PortSpec& spec) {
    const std::string& link = spec.get<PtyOptions>()->link;
    return link.empty() ? std::vector<PortType::Claim>() : std::vector<PortType::Claim>{{"link", link}};
  };
  return type;
}

}  // namespace porttape
