#pragma once

#include <memory>
#include <string>

#include "libport/catalog/channel.hpp"
#include "tests/simulation/line.hpp"

namespace porttape::simulation {

// A channel of the daemon that records (or bridges), with a driver and a device that do what chance wants,
// and what must hold of it.
class LiveChannel {
 public:
  LiveChannel(World& world, std::string name, bool records, bool disk_fails);
  LiveChannel(const LiveChannel&) = delete;
  LiveChannel& operator=(const LiveChannel&) = delete;

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] ChannelSpec spec() const;

  void start();
  // From now on both programs only read, and nothing goes wrong any more.
  void calm();
  // After a calm minute: nothing is under way.
  void check_calm();
  // After the daemon's end.
  void check_end(bool failed);

 private:
  void driver_acts();
  void device_acts();
  void reads_soon(Line& line, bool& stalls, bool& planned);
  void check_line();
  void check_tape(bool failed);
  [[nodiscard]] std::uint64_t told() const;

  World* world_;
  std::string name_;
  bool records_;
  bool disk_fails_;
  bool calm_ = false;
  std::int64_t driver_acts_left_;
  std::int64_t device_acts_left_;
  Nanos pace_;
  std::size_t most_bytes_;
  Line driver_;
  Line device_;
  bool driver_stalls_ = false;
  bool device_stalls_ = false;
  bool driver_reads_ = false;
  bool device_reads_ = false;
};

}  // namespace porttape::simulation
