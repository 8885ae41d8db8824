#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "libport/base/result.hpp"
#include "libport/base/time.hpp"
#include "libport/catalog/channel.hpp"
#include "libport/tape/tape_name.hpp"
#include "libport/taped/replay_options.hpp"
#include "tools/supervision.hpp"

namespace porttape {

// What a test of a command against a tape is to do.
struct TestRequest {
  ChannelPorts ports;
  std::optional<Nanos> timeout;
  bool never_ends = false;  // --timeout 0: the command ends by itself alone
  std::vector<std::string> command;
  std::optional<TapePaths> record_to = {};  // a tape of the run itself
  std::string repeat_line = {};             // for the report, as is the next
  std::string step_line = {};
  bool looks_on = false;  // after a mismatch, for a moment, so that the report knows more
  std::optional<Supervision> supervision = {};
  bool output_to_stderr = false;  // the command's, where stdout is for the verdict alone

  [[nodiscard]] const ReplayOptions& replay() const { return *ports.device.get<ReplayOptions>(); }
};

// The options of such a test: of `porttape test` and of a suite's file.
std::vector<OptionSpec> test_options();

// A test by its options as they were written, the driver's port among them. Errc::usage names the option that
// is wrong.
Result<TestRequest> read_test(std::map<std::string, std::string> values, std::vector<std::string> command);

}  // namespace porttape
