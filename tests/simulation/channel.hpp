#pragma once

#include <algorithm>
#include <string>
#include <string_view>
#include <utility>

#include "libport/catalog/channel.hpp"
#include "tests/simulation/world.hpp"

namespace porttape::simulation {

// A channel of the simulated daemon with the programs at its ends, and what must hold of it.
class Channel {
 public:
  Channel(World& world, std::string name) : world_(&world), name_(std::move(name)) {}
  virtual ~Channel() = default;
  Channel(const Channel&) = delete;
  Channel& operator=(const Channel&) = delete;

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] virtual ChannelSpec spec() const = 0;
  virtual void start() = 0;
  // From now on nothing goes wrong any more, and nothing new is begun.
  virtual void calm() = 0;
  // After a calm minute: nothing is under way.
  virtual void check_calm() = 0;
  // Its driver looks again and again for what may not come: the world's own wake-ups, and not the daemon's.
  [[nodiscard]] virtual bool looks_on() const { return false; }
  // After the daemon's end; `failed`: its exit status was not 0.
  virtual void check_end(bool failed) = 0;

 protected:
  [[nodiscard]] World& world() const { return *world_; }
  // Whether the channel has logged a line with this text.
  [[nodiscard]] bool has_logged(std::string_view text) const {
    return std::ranges::any_of(world_->logged(), [&](const std::string& line) {
      return line.starts_with(name_ + ": ") && line.find(text) != std::string::npos;
    });
  }

 private:
  World* world_;
  std::string name_;
};

}  // namespace porttape::simulation
