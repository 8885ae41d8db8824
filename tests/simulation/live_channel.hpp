#pragma once

#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>
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
  void device_acts();
  void reads_soon(Line& line, bool& stalls, bool& planned);
  void replace_tape();
  [[nodiscard]] std::string faults() const;
  void check_line();
  void check_tape(bool failed);
  [[nodiscard]] std::uint64_t told() const;
  [[nodiscard]] std::uint64_t told_by(std::initializer_list<std::string_view> texts) const;
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
  Line driver_;
  Line device_;
  bool driver_stalls_ = false;
  bool device_stalls_ = false;
  bool driver_reads_ = false;
  bool device_reads_ = false;
};

}  // namespace porttape::simulation
