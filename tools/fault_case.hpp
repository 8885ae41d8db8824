#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/port/port_type.hpp"
#include "libport/tape/tape_name.hpp"
#include "tools/command_verb.hpp"
#include "tools/fault_run.hpp"

namespace porttape {

// What `soak` and `shrink` have in common: a command that faults may break, and what counts as broken.
struct FaultCase {
  enum class FailsBy : std::uint8_t { signal, status, verdict };

  FaultRunSetup setup;
  TapePaths tape;
  std::string faults;  // a plan; empty: none was given
  std::uint64_t seed = 0;
  FailsBy fails_by = FailsBy::status;
  std::size_t jobs = 1;
  bool as_json = false;
};

// A failure, so far as it can be told from another one.
struct FaultFailure {
  std::string text;  // for a person
  std::string kind;  // `hung`, `signal 11`, `status 1`, `verdict data-mismatch`
  friend bool operator==(const FaultFailure&, const FaultFailure&) = default;
};

// Options of both, and what was given of them (`seeds`, `output` and the like are the verb's own and stay in
// `line`). Errc::usage.
std::vector<OptionSpec> fault_case_options();
Result<FaultCase> read_fault_case(CommandVerbLine& line);

// Nothing where it is no failure.
std::optional<FaultFailure> failure_of(const FaultRunEnd& end, FaultCase::FailsBy by);

// The lines to type: a run of this tape with these faults, and the verb `shrink` on it.
std::string test_line(const FaultCase& the_case, const std::string& tape, const std::string& faults,
                      std::uint64_t seed);
std::string shrink_line(const FaultCase& the_case, const std::string& faults, std::uint64_t seed);

// The last lines that a command has written, indented, for a report; empty where there are none.
std::string last_lines(const std::string& output);

}  // namespace porttape
