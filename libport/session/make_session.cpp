#include "libport/session/make_session.hpp"

#include <utility>

#include "libport/catalog/port_types.hpp"

namespace porttape {

Result<std::unique_ptr<Session>> make_session(const PortContext& context, const ChannelPorts& ports,
                                              std::function<void(int)> on_end) {
  Result<std::unique_ptr<Port>> driver = make_port(context, ports.driver, ports.device.spelled());
  if (!driver) return driver.error();
  Result<std::unique_ptr<Port>> device = make_port(context, ports.device, ports.driver.spelled());
  if (!device) return device.error();
  return std::make_unique<Session>(context, std::move(*driver), std::move(*device), std::move(on_end));
}

}  // namespace porttape
