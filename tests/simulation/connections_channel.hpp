#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "libport/tape/tape_name.hpp"
#include "tests/simulation/channel.hpp"
#include "tests/simulation/hall.hpp"
#include "tests/simulation/line.hpp"

namespace porttape::simulation {

// A channel with `--connections each`: several drivers at a time, each with a device and a tape of its own,
// and what must hold of each of them alone.
class ConnectionsChannel final : public Channel {
 public:
  ConnectionsChannel(World& world, std::string name, bool records, bool disk_fails);

  [[nodiscard]] ChannelSpec spec() const override;
  void start() override;
  void calm() override;
  void check_calm() override;
  void check_end(bool failed) override;

 private:
  // What one side does with its line.
  struct End {
    End(World& world, const std::string& name, Line::Kind kind) : line(world, name, kind) {}
    Line line;
    std::int64_t acts_left = 0;
    bool stalls = false;
    bool reads = false;  // soon
  };
  struct Pair {
    Pair(World& world, const std::string& name);
    End driver;
    End device;
    unsigned number = 0;  // as the daemon counts it; 0: it was not taken
  };

  void connect();
  Line& next_device();
  void acts(End& end);
  void reads_soon(End& end);
  void check(const Pair& pair);
  void check_tapes(const Pair& pair);

  bool records_;
  bool disk_fails_;
  bool calm_ = false;
  Nanos pace_;
  std::int64_t most_bytes_;
  std::int64_t to_come_;
  unsigned came_ = 0;
  bool connecting_ = false;
  std::deque<Pair> pairs_;
  std::deque<Line> probes_;  // that nobody connects for
  Hall hall_;
};

}  // namespace porttape::simulation
