#pragma once

#include <memory>
#include <string>

#include "libport/base/result.hpp"
#include "libport/catalog/channel.hpp"
#include "libport/supervise/tapped_line.hpp"

namespace porttape {

// `ports` of a recording, with the ends of this line in their place: of a command that keeps its own device.
// `command` is for the tape's header.
Result<ChannelPorts> tapped_ports(ChannelPorts ports, const std::shared_ptr<TappedLine>& line,
                                  const std::string& command);

}  // namespace porttape
