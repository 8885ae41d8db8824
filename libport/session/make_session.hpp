#pragma once

#include <functional>
#include <memory>

#include "libport/catalog/channel.hpp"
#include "libport/port/context.hpp"
#include "libport/session/session.hpp"

namespace porttape {

// A session of the two ports that these describe. Errc::usage.
Result<std::unique_ptr<Session>> make_session(const PortContext& context, const ChannelPorts& ports,
                                              std::function<void(int exit_status)> on_end);

// The same, or where each connection of the driver's port has a line of its own, Connections.
Result<std::unique_ptr<Channel>> make_channel(const PortContext& context, const ChannelPorts& ports,
                                              std::function<void(int exit_status)> on_end);

}  // namespace porttape
