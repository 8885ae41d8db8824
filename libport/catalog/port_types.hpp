#pragma once

#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/port/port_options.hpp"

namespace porttape {

// Every type of port that porttape has: the one table. A new one is a row in it.
const PortTypes& port_types();

// Text to a port to be made, by that table; see parse_port() and check_options() of port/port_options.hpp.
inline Result<PortSpec> parse_port(std::string_view spec) { return parse_port(port_types(), spec); }
inline Result<PortOptions> check_options(std::map<std::string, std::string> values) {
  return check_options(port_types(), std::move(values));
}

// The port. `peer` says what is at the line's other end, for a tape's header.
inline Result<std::unique_ptr<Port>> make_port(const PortContext& context, const PortSpec& spec,
                                               const std::string& peer) {
  return spec.type().make(context, spec, peer);
}

}  // namespace porttape
