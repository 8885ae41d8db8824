#pragma once

#include <memory>
#include <string>

#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/port/port_options.hpp"

namespace porttape {

// The port that these options name. `peer` says what is at the other end, for a tape's header. The options
// come from parse_port() or check_port(). Errc::usage where options contradict each other.
Result<std::unique_ptr<Port>> make_port(const PortContext& context, const PortOptions& options,
                                        const std::string& peer);

}  // namespace porttape
