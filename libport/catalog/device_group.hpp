#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/port/context.hpp"
#include "libport/port/port.hpp"
#include "libport/port/port_options.hpp"
#include "libport/tape/tape_name.hpp"

namespace porttape {

// The device's ports of a channel in which each of the driver's connections has a line of its own: made out
// of one spec, with a tape each where it records, and the tapes of such a group where it replays. Loop thread
// only.
class DeviceGroup {
 public:
  virtual ~DeviceGroup() = default;

  // Whether the devices and the tapes are such as the connections can use: as Port::prepare(), but touches
  // nothing.
  virtual Result<void> prepare() = 0;
  // The port for a connection: 1, 2, … as they come. Errc::usage: there is none for it.
  virtual Result<std::unique_ptr<Port>> port_for(unsigned connection) = 0;
  // Before the same is asked of the ports.
  virtual void request(const RecorderRequest&) {}
  // The end, with so many connections having come: completes what nobody came for, one after the other.
  // `done` comes once, from within or later, with an exit status.
  virtual void finish(unsigned came, std::function<void(int exit_status)> done) = 0;

  // How many that are.
  [[nodiscard]] virtual unsigned left_over(unsigned came) const {
    (void)came;
    return 0;
  }

  // A tape that fails ends all connections.
  [[nodiscard]] virtual bool must_not_fail() const { return false; }
  // So many connections are the whole, and the channel ends with the last of them; none: it goes on.
  [[nodiscard]] virtual std::optional<unsigned> ends_after() const { return std::nullopt; }
};

// By the type of the device's port. `driver` is the driver's port, for the tapes' headers.
std::unique_ptr<DeviceGroup> make_device_group(const PortContext& context, const PortSpec& device,
                                               const std::string& driver);

// Whether connections to this driver's port can be told apart, and (`each`) have a device's port of their
// own. Errc::usage.
Result<void> check_connections(const PortSpec& driver, const PortSpec& device, bool each);

// The tapes of a group that was recorded so: `laser.log`, `laser.c2.log`, ….
std::vector<TapePaths> tapes_of_group(const TapePaths& first);

}  // namespace porttape
