#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "tests/simulation/replay_plan.hpp"
#include "tests/simulation/report_file.hpp"
#include "tests/simulation/world.hpp"

namespace porttape::simulation {

// What became of a replay, as the driver and the user saw it.
struct ReplayEnd {
  bool failed = false;        // the daemon's exit status was not 0
  bool finished = false;      // the driver did all that it wanted
  bool lost_bytes = false;    // the log tells of bytes that reached nobody
  bool made_mistake = false;  // that of the plan
  bool half_close_may_be_missed = false;
  bool missed_settings = false;  // the line ended before the driver had made them
  std::size_t item = 0;          // that the driver came to
  std::uint64_t written = 0;     // bytes, by the driver
  std::uint64_t bytes_in = 0;    // that the replay was told of
  std::uint64_t bytes_out = 0;   // that it gave the driver
  std::uint64_t steps = 0;       // that the user asked for
};

// Whether the report tells what was.
void check_report(World& world, const std::string& name, const ReplayPlan& plan, const ReportFile& report,
                  const ReplayEnd& end);

}  // namespace porttape::simulation
