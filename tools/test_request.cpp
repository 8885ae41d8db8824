#include "tools/test_request.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

#include "libport/taped/report_file.hpp"
#include "libport/taped/types.hpp"
#include "tools/command_verb.hpp"

namespace porttape {
namespace {

const OptionSpec kCommandTimeout{
    .name = "timeout",
    .kind = OptionSpec::Kind::number,
    .help = "after how long the command is ended; 0: never, not even one that sleeps for ever",
    .max = 1e9,
    .unit = "s"};

}  // namespace

std::vector<OptionSpec> test_options() {
  std::vector<OptionSpec> specs = options_of_one_run(ChannelMode::replay);
  for (OptionSpec& spec : specs) {
    spec.default_value = replay_default(ReplayUse::test, spec.name, spec.default_value);
  }
  specs.push_back(kCommandTimeout);
  for (OptionSpec& option : supervision_options(true)) specs.push_back(std::move(option));
  return specs;
}

Result<TestRequest> read_test(std::map<std::string, std::string> values, std::vector<std::string> command) {
  const Result<std::optional<Supervision>> supervision = take_supervision(values, true);
  if (!supervision) return supervision.error();
  ChannelSpec channel{ChannelMode::replay, std::move(values)};
  std::optional<Nanos> limit;
  bool never_ends = false;
  if (const auto timeout = channel.values.extract("timeout")) {
    const Result<std::string> checked = check_value(kCommandTimeout, timeout.mapped());
    if (!checked) return checked.error();
    const double given = std::stod(*checked);
    never_ends = given == 0;
    if (given > 0) limit = std::chrono::duration_cast<Nanos>(std::chrono::duration<double>(given));
  }
  set_replay_defaults(ReplayUse::test, channel.values);
  Result<ChannelPorts> ports = channel_ports(channel);
  if (!ports) return ports.error();
  TestRequest request{std::move(*ports), limit, never_ends, std::move(command)};
  request.supervision = *supervision;
  for (const std::string& file : {request.replay().report_file, request.replay().junit_file}) {
    if (file.empty()) continue;
    if (Result<void> place = check_report_place(file); !place) return place.error();
  }
  return request;
}

}  // namespace porttape
