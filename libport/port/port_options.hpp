#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "libport/base/result.hpp"

namespace porttape {

// A port as a user names it: a type and its options (contract section 2). Values are as written; the typed
// getters have been checked by parse_port()/check_port(), so they cannot fail on a checked object.
struct PortOptions {
  std::string type;
  std::map<std::string, std::string> values;  // a boolean option has the value "1" when on; absent when off

  [[nodiscard]] bool has(const std::string& option) const { return values.contains(option); }
  // The option's value, or the type's default for it.
  [[nodiscard]] std::string text(const std::string& option) const;
  [[nodiscard]] bool flag(const std::string& option) const;
  [[nodiscard]] long integer(const std::string& option) const;
  [[nodiscard]] double number(const std::string& option) const;

  // The short spelling of its main part, for messages: `serial:/dev/ttyUSB0`, `tcp-listen:127.0.0.1:20000`.
  [[nodiscard]] std::string name() const;
  // The same with every other option that was given, such as parse_port() reads (a comma within a value
  // apart, which no spelling has).
  [[nodiscard]] std::string spelled() const;

  friend bool operator==(const PortOptions&, const PortOptions&) = default;
};

// Reads either spelling: `type=serial,device=/dev/ttyUSB0,baud=115200` or `serial:/dev/ttyUSB0,baud=115200`;
// a bare `/dev/…` is `serial:`, `tcp-listen:127.0.0.1:2112` sets `listen`. Errc::usage names the option, its
// value and what would be accepted.
Result<PortOptions> parse_port(std::string_view spec);

// The same checks for options that came as a map.
Result<PortOptions> check_port(PortOptions options);

// The types and their options with defaults, for --help.
std::string port_help();

}  // namespace porttape
