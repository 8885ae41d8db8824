#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "tests/simulation/play_clock.hpp"
#include "tests/simulation/replay_plan.hpp"
#include "tests/simulation/report_file.hpp"
#include "tests/simulation/world.hpp"

namespace porttape::simulation {

// What must hold of what a replayed tape's driver is given, by what that driver and its user did. It is told
// of both in their order, and reports what is wrong to the world. Refers to the world and the plan, which
// must outlive it.
class ReplayCheck {
 public:
  ReplayCheck(World& world, std::string name, const ReplayPlan& plan);

  // The driver.
  void opened(std::size_t item);
  void did(std::size_t item);  // all of it
  void wrote(std::size_t bytes);
  void hung_up();  // on the driver
  void gave_up();  // the driver, what it has not been given

  // Its line was given these bytes.
  void came(ByteView data);

  // The user. going_on() comes before the request, and going_on(), paused() and has_rate() only if it is
  // granted.
  void going_on();
  void paused(bool on);
  void has_rate(double rate);
  void steps(std::uint64_t count);          // before the request
  void refused_steps(std::uint64_t count);  // after it
  // What could come by hand has come. `item`: that the driver is at.
  void check_steps(std::size_t item);

  [[nodiscard]] const PlayClock& clock() const { return clock_; }
  // Which pause it is, or was: it changes with each.
  [[nodiscard]] std::uint64_t pause() const { return pause_; }
  // Whether the reads before this item have come.
  [[nodiscard]] bool has_come(std::size_t item) const;
  [[nodiscard]] std::size_t delivered() const { return delivered_; }
  [[nodiscard]] std::uint64_t written() const { return written_; }
  [[nodiscard]] std::uint64_t steps_asked() const { return steps_asked_; }
  // The last of what the driver wrote or was given.
  [[nodiscard]] Instant last_event() const { return last_event_; }
  // "At strictness 0 […] or the driver has written something and been quiet for 50 ms, or `--patience`".
  [[nodiscard]] bool gates_are_lenient() const;
  // The loop may have stood, behind another channel's disk, until the patience for it was over.
  [[nodiscard]] bool half_close_may_be_missed() const;

 private:
  void notice_event();
  void check_order(ByteView data);
  void check_time(std::size_t begin, std::size_t end);
  void check_by_hand(const Answer& answer, double due);
  bool is_of_whole_answers(ByteView data);
  [[nodiscard]] bool is_of_same_step(const Answer& answer) const;
  [[nodiscard]] std::size_t released() const;
  [[nodiscard]] std::optional<double> due_of(const Answer& answer) const;

  World* world_;
  std::string name_;
  const ReplayPlan* plan_;
  PlayClock clock_;
  std::vector<std::optional<double>> done_;  // played time of the driver's items, by item
  std::vector<std::optional<double>> due_;   // played time of the answers, by answer
  std::uint64_t written_ = 0;
  std::size_t delivered_ = 0;
  std::size_t next_answer_ = 0;         // the first that has not come whole
  std::set<std::size_t> places_ = {0};  // where in what the device sent the driver may be, in any order
  bool reopened_ = false;
  bool gave_up_ = false;
  Instant last_event_{};
  Instant first_opened_{};
  Nanos longest_quiet_{};  // of driver and device

  bool stepped_ = false;
  std::uint64_t steps_asked_ = 0;
  std::uint64_t steps_left_ = 0;   // in this pause
  std::optional<Answer> by_hand_;  // the first that the latest step let come
  bool hung_up_by_hand_ = false;   // in this pause: a hang-up may be what a step let come
  std::size_t hand_until_ = 0;     // the first exchange that no step before the last resume let come
  std::uint64_t pause_ = 0;
};

}  // namespace porttape::simulation
