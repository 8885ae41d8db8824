#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "tests/simulation/channel.hpp"
#include "tests/simulation/line.hpp"
#include "tests/simulation/replay_check.hpp"
#include "tests/simulation/replay_plan.hpp"

namespace porttape::simulation {

// A channel that replays a tape to a driver which does what the recorded one did, or does one thing wrong,
// and a user who pauses it, lets it go by hand and changes its rate.
class ReplayChannel final : public Channel {
 public:
  // `stalls`: another channel's disk may hold the loop up, so that what is due comes late.
  ReplayChannel(World& world, std::string name, bool stalls);

  [[nodiscard]] ChannelSpec spec() const override;
  void start() override;
  void calm() override;
  void check_calm() override;
  [[nodiscard]] bool looks_on() const override { return looks_for_hang_up_; }
  void check_end(bool failed) override;

 private:
  // The driver.
  void act();
  void act_at(Instant when);
  void go_on();
  bool goes_on_without_line(const TapeItem& item);
  void do_item(const TapeItem& item);
  void open();
  void close();
  void flush();
  void arrived();
  bool write_on();
  bool begin_write();
  void next_item();
  void ends();
  bool has_read(std::size_t items) const;
  [[nodiscard]] bool need_not_wait() const;
  bool waits();
  [[nodiscard]] bool may_have_ended() const;
  bool is_unseen();
  [[nodiscard]] Nanos look_for_hang_up() const;
  [[nodiscard]] Instant write_time() const;
  [[nodiscard]] bool is_last_item() const { return item_ + 1 == plan_.script().items().size(); }

  // The user.
  void control();
  void look_at_status();
  void ask_pause(bool on);
  void ask_step();
  void ask_rate();
  bool ask(const std::string& request);

  [[nodiscard]] std::string rules() const { return (world().folder() / (name() + ".rules")).string(); }
  [[nodiscard]] std::string tape() const { return (world().folder() / (name() + ".log")).string(); }
  [[nodiscard]] std::filesystem::path report() const { return world().folder() / (name() + ".json"); }
  [[nodiscard]] std::array<std::string, 3> tape_files() const;

  const bool hurries_;
  Line driver_;
  ReplayPlan plan_;
  ReplayCheck check_;
  std::array<std::string, 3> tape_before_;

  std::size_t item_ = 0;  // that the driver is at
  std::optional<Instant> not_before_;
  bool in_write_ = false;
  Bytes to_write_;  // of this item
  Instant opened_{};
  std::optional<Instant> unseen_until_;
  bool acting_ = false;
  bool finished_ = false;
  bool looks_for_hang_up_ = false;
  bool broken_ = false;  // the line, by the replay
  bool made_mistake_ = false;
  bool missed_settings_ = false;  // maybe: the line had ended
  std::int64_t controls_left_;
  bool calm_ = false;
};

}  // namespace porttape::simulation
