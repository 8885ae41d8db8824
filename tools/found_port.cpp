#include "tools/found_port.hpp"

#include <spdlog/logger.h>

#include "libport/base/printable.hpp"

namespace porttape {

std::optional<DevicePort> port_to_find(const Supervision& supervision, const Port& driver, const Port* device,
                                       spdlog::logger& log) {
  std::optional<PortIdentity> identity = supervision.as;
  if (!identity && supervision.finds && device != nullptr) identity = device->identity();
  DevicePort port{identity.value_or(PortIdentity()), driver.place().node};
  if (!identity || port.node.empty()) return std::nullopt;
  const Result<void> possible = can_enter_device_view({port});
  if (possible) return port;
  log.warn("{} cannot be shown to the command: {}; it finds its port by {{port}} alone",
           in_quotes(port.identity.path), printable_line(possible.error().message));
  return std::nullopt;
}

}  // namespace porttape
