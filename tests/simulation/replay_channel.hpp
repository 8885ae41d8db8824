#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "tests/simulation/channel.hpp"
#include "tests/simulation/line.hpp"

namespace porttape::simulation {

// A channel that replays a tape to a driver which does what the recorded one did, or does one thing wrong.
class ReplayChannel final : public Channel {
 public:
  ReplayChannel(World& world, std::string name);

  [[nodiscard]] ChannelSpec spec() const override;
  void start() override;
  void calm() override;
  void check_calm() override;
  void check_end(bool failed) override;

 private:
  enum class Driver { as_recorded, one_byte_wrong, leaves_early };
  struct Step {
    bool reads = false;
    Bytes data;
    unsigned baud = 0;  // set before it; 0: none
  };

  void make_tape();
  void act();
  void write_on();
  void next_step();
  void take_in(ByteView data);
  bool is_in_order(ByteView data) const;
  bool is_of_whole_answers(ByteView data);
  [[nodiscard]] std::size_t released() const;
  [[nodiscard]] std::string chunks() const;
  [[nodiscard]] bool by_lookup() const;
  [[nodiscard]] bool one_request_begins_another() const;
  [[nodiscard]] bool resyncs() const { return expected_.size() % 5 == 0; }
  [[nodiscard]] std::filesystem::path report() const { return world().folder() / (name() + ".json"); }

  Driver driver_does_;
  Line driver_;
  std::vector<Step> steps_;
  std::size_t step_ = 0;       // of the driver
  bool set_ = false;           // what that step begins with
  std::size_t leaves_at_ = 0;  // step
  Bytes to_write_;             // of this step
  std::uint64_t written_ = 0;
  Bytes expected_;  // all that the tape's device sent
  std::size_t read_ = 0;
  std::set<std::size_t> answers_;       // where in it an answer begins
  std::set<std::size_t> places_ = {0};  // where in it the driver may be that gets answers in any order
  bool pause_decides_ = false;          // which request it is that the driver has written
  bool acting_ = false;
  bool left_ = false;
};

}  // namespace porttape::simulation
