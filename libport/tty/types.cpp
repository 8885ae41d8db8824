#include "libport/tty/types.hpp"

#include <algorithm>
#include <iterator>
#include <memory>
#include <optional>
#include <string>

#include "libport/port/port_options.hpp"
#include "libport/tty/pty_port.hpp"
#include "libport/tty/serial_port.hpp"

namespace porttape {
namespace {

using Kind = OptionSpec::Kind;

std::optional<bool> on_or_off(const PortOptions& written, const std::string& option) {
  return written.has(option) ? std::optional(written.text(option) == "on") : std::nullopt;
}

Result<SerialOptions> serial_options(const PortOptions& written) {
  return SerialOptions{.device = written.text("device"),
                       .settings = line_settings(written),
                       .dtr = on_or_off(written, "dtr"),
                       .rts = on_or_off(written, "rts"),
                       .wait = written.flag("wait"),
                       .follow = written.text("settings") == "follow",
                       .uucp_lock = written.flag("uucplock")};
}

Result<PtyOptions> pty_options(const PortOptions& written) {
  const Result<unsigned> mode = written.mode("mode");
  if (!mode) return mode.error();
  return PtyOptions{.link = written.text("link"),
                    .bind = written.text("bind"),
                    .access = {*mode, written.text("owner"), written.text("group")}};
}

}  // namespace

PortType serial_type() {
  PortType type{"serial", {"device"}, "a serial device"};
  type.recorded_as = "seriallog";
  type.exclusive = true;
  type.options = {{.name = "device", .default_value = "/dev/ttyS0", .help = "the tty", .value_name = "PATH"}};
  std::ranges::copy(line_setting_options(), std::back_inserter(type.options));
  const std::vector<OptionSpec> rest = with_common({
      {"dtr",
       Kind::choice,
       "",
       "sets the line DTR after opening; else as the system does",
       0,
       0,
       {"on", "off"}},
      {"rts",
       Kind::choice,
       "",
       "sets the line RTS after opening; else as the system does",
       0,
       0,
       {"on", "off"}},
      {"settings",
       Kind::choice,
       "follow",
       "follow: what the driver sets on its port reaches the device; keep: it does not",
       0,
       0,
       {"follow", "keep"}},
      {"wait", Kind::flag, "", "waits for a device that is missing, else that is an error"},
      {"uucplock", Kind::flag, "",
       "makes lock files in /var/lock while it is open; others' are always honoured"},
  });
  std::ranges::copy(rest, std::back_inserter(type.options));
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
      {.name = "link",
       .help = "where the driver finds it, a symbolic link; else the path to open is printed",
       .value_name = "PATH"},
      {.name = "bind",
       .help =
           "a file on which it is mounted, for containers, where a link leads nowhere; needs CAP_SYS_ADMIN",
       .value_name = "PATH"},
      {.name = "mode",
       .default_value = "0600",
       .help = "who may open it: permissions, octal",
       .value_name = "MODE"},
      {.name = "owner", .help = "whose it is: name or number of a user", .value_name = "USER"},
      {.name = "group", .help = "whose it is: name or number of a group", .value_name = "GROUP"},
  });
  type.read = reads(pty_options);
  type.make = makes<PtyOptions>([](const auto& context, const auto&, const auto& options) {
    return std::make_unique<PtyPort>(context, options);
  });
  type.claims = [](const PortSpec& spec) {
    const PtyOptions& options = *spec.get<PtyOptions>();
    std::vector<PortType::Claim> claims;
    for (const std::string& path : {options.link, options.bind}) {
      if (!path.empty()) claims.emplace_back("link", path);
    }
    return claims;
  };
  return type;
}

}  // namespace porttape
