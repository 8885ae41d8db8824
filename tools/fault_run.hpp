#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "tools/request_tracker.hpp"

namespace porttape {

// What `soak` and `shrink` run again and again: a command against a tape with faults on its line.
struct FaultRunSetup {
  std::map<std::string, std::string> values;  // of `test`, without tape, driver, faults and seed
  std::vector<std::string> command;
};

// One such run.
struct FaultRunJob {
  std::string tape;
  std::string faults = {};  // a plan; empty: none
  std::uint64_t seed = 0;
  bool tracks = false;  // how far the driver comes on the tape, see RequestTracker
  bool exact = true;
  std::optional<std::size_t> enough = {};  // it is ended once it has reached so many parts, or
  bool ends_at_unknown = false;            // once it has asked what is not on the tape

  friend bool operator==(const FaultRunJob&, const FaultRunJob&) = default;
};

// How it ended.
struct FaultRunEnd {
  int status = 0;
  int signal = 0;
  std::string ended_because = {};  // we ended the command: it hung
  std::string verdict = {};
  bool passed = false;                   // the verdict
  bool enough = false;                   // ended by one of these
  std::vector<std::string> faults = {};  // the plans of those made; at most 10 000
  std::uint64_t faults_made = 0;
  std::uint64_t bytes = 0;  // that passed on its line, both ways
  std::vector<RequestTracker::Turn> turns = {};
  std::size_t reach = 0;
  bool beyond = false;
  std::string unknown_hex = {};

  friend bool operator==(const FaultRunEnd&, const FaultRunEnd&) = default;
};

// Does it, here and now; its port is in a folder of its own. Errc::usage, Errc::io: it could not be done.
Result<FaultRunEnd> do_fault_run(const FaultRunSetup& setup, const FaultRunJob& job);

// For another process.
std::string to_text(const FaultRunJob& job);
FaultRunJob fault_run_job(const std::string& text);
std::string to_text(const FaultRunEnd& end);
FaultRunEnd fault_run_end(const std::string& text);

}  // namespace porttape
