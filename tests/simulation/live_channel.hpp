#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "libport/tape/tape_name.hpp"
#include "tests/simulation/channel.hpp"
#include "tests/simulation/line.hpp"

namespace porttape::simulation {

// A channel of the daemon that records (or bridges), with a driver and a device that do what chance wants,
// and what must hold of it.
class LiveChannel final : public Channel {
 public:
  LiveChannel(World& world, std::string name, bool records, bool disk_fails);

  [[nodiscard]] ChannelSpec spec() const override;
  void start() override;
  // Both programs only read.
  void calm() override;
  void check_calm() override;
  void check_end(bool failed) override;

 private:
  void driver_acts();
  void driver_opens();
  void driver_does_to_line();
  void driver_sets();
  void device_acts();
  void reads_soon(Line& line, bool& stalls, bool& planned);
  void replace_tape();
  [[nodiscard]] std::string faults() const;
  [[nodiscard]] bool faults_on_driver() const { return most_bytes_ % 16 == 11; }
  [[nodiscard]] bool has_faults() const { return faults_on_driver() || !faults().empty(); }
  void check_line();
  void check_cut(std::size_t bytes);
  void check_tape(bool failed);
  [[nodiscard]] std::uint64_t lost_by_line() const;
  [[nodiscard]] std::vector<TapePaths> tapes() const;

  bool records_;
  bool disk_fails_;
  bool next_tape_;
  bool fail_closed_;
  bool calm_ = false;
  std::int64_t driver_acts_left_;
  std::int64_t device_acts_left_;
  Nanos pace_;
  std::size_t most_bytes_;
  bool device_is_slow_;  // takes what comes in the course of a minute
  Line driver_;
  Line device_;
  // A tape begins with the first open of a channel: what is lost before is on none.
  std::optional<std::uint64_t> lost_at_prepare_;
  std::uint64_t lost_without_tape_ = 0;
  bool driver_waits_ = false;       // in a call
  std::uint64_t driver_calls_ = 0;  // of those that it may wait in
  bool driver_stalls_ = false;
  bool device_stalls_ = false;
  bool driver_reads_ = false;
  bool device_reads_ = false;
};

}  // namespace porttape::simulation
