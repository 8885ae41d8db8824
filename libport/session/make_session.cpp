#include "libport/session/make_session.hpp"

#include <utility>

#include "libport/catalog/device_group.hpp"
#include "libport/catalog/port_types.hpp"
#include "libport/session/connections.hpp"

namespace porttape {

Result<std::unique_ptr<Session>> make_session(const PortContext& context, const ChannelPorts& ports,
                                              std::function<void(int)> on_end) {
  Result<std::unique_ptr<Port>> driver = make_port(context, ports.driver, ports.device.spelled());
  if (!driver) return driver.error();
  Result<std::unique_ptr<Port>> device = make_port(context, ports.device, ports.driver.spelled());
  if (!device) return device.error();
  return std::make_unique<Session>(context, std::move(*driver), std::move(*device), std::move(on_end));
}

Result<std::unique_ptr<Channel>> make_channel(const PortContext& context, const ChannelPorts& ports,
                                              std::function<void(int)> on_end) {
  if (!ports.each_connection) {
    Result<std::unique_ptr<Session>> session = make_session(context, ports, std::move(on_end));
    if (!session) return session.error();
    return std::unique_ptr<Channel>(std::move(*session));
  }
  Result<std::unique_ptr<Port>> driver = make_port(context, ports.driver, ports.device.spelled());
  if (!driver) return driver.error();
  return std::unique_ptr<Channel>(std::make_unique<Connections>(
      context, std::move(*driver), make_device_group(context, ports.device, ports.driver.spelled()),
      std::move(on_end)));
}

}  // namespace porttape
