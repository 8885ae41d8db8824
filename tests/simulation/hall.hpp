#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "libport/port/port.hpp"
#include "tests/simulation/line.hpp"
#include "tests/simulation/world.hpp"

namespace porttape::simulation {

class HallPort;

// Where drivers connect, each with a line of its own, and where each of them gets a device of its own. The
// near end is a HallPort.
class Hall {
 public:
  // `devices`: the far end of the next device's port. It outlives all ports.
  Hall(World& world, std::string name, std::function<Line&()> devices)
      : world_(&world), name_(std::move(name)), devices_(std::move(devices)) {}
  Hall(const Hall&) = delete;
  Hall& operator=(const Hall&) = delete;

  // The far end opens `line`. False: nobody takes connections.
  bool connect(Line& line);

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] Line& next_device() const { return devices_(); }
  [[nodiscard]] std::unique_ptr<Port> make_port();

 private:
  friend class HallPort;
  World* world_;
  std::string name_;
  std::function<Line&()> devices_;
  HallPort* port_ = nullptr;
};

}  // namespace porttape::simulation
