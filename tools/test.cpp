#include <algorithm>
#include <chrono>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <optional>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "libport/base/printable.hpp"
#include "libport/catalog/channel.hpp"
#include "libport/taped/report_file.hpp"
#include "libport/taped/types.hpp"
#include "tools/command_verb.hpp"
#include "tools/output.hpp"
#include "tools/test_run.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

constexpr std::string_view kAbout =
    "Runs COMMAND against a tape in the device's place and prints the verdict.\n\n"
    "Exit status: 0 pass, 1 failure at run time or of the command itself, 2 wrong\n"
    "use, 3 other data, 4 other timing, 5 incomplete; 130 and 143 when interrupted.\n\n";

std::vector<OptionSpec> test_options() {
  std::vector<OptionSpec> specs = channel_options(ChannelMode::replay);
  std::erase_if(specs, [](const OptionSpec& spec) { return spec.name == "once"; });
  for (OptionSpec& spec : specs) {
    spec.default_value = replay_default(ReplayUse::test, spec.name, spec.default_value);
  }
  specs.push_back({.name = "timeout",
                   .kind = OptionSpec::Kind::number,
                   .help = "after how long the command is ended; 0: never, not even one that sleeps for ever",
                   .max = 1e9,
                   .unit = "s"});
  specs.push_back(color_option());
  return specs;
}

Result<ColorChoice> take_color(CommandVerbLine& line) {
  const auto given = line.values.extract("color");
  return given ? read_color(given.mapped()) : ColorChoice::automatic;
}

Result<TestRequest> read_request(CommandVerbLine line, const std::vector<OptionSpec>& specs) {
  ChannelSpec channel{ChannelMode::replay, std::move(line.values)};
  std::optional<Nanos> limit;
  bool never_ends = false;
  if (const auto timeout = channel.values.extract("timeout")) {
    const auto spec = std::ranges::find(specs, "timeout", &OptionSpec::name);
    const Result<std::string> checked = check_value(*spec, timeout.mapped());
    if (!checked) return checked.error();
    const double given = std::stod(*checked);
    never_ends = given == 0;
    if (given > 0) limit = std::chrono::duration_cast<Nanos>(std::chrono::duration<double>(given));
  }
  set_replay_defaults(ReplayUse::test, channel.values);
  Result<ChannelPorts> ports = channel_ports(channel);
  if (!ports) return ports.error();
  TestRequest request{std::move(*ports), limit, never_ends, std::move(line.command)};
  if (const std::string& file = request.replay().report_file; !file.empty()) {
    if (Result<void> place = check_report_place(file); !place) return place.error();
  }
  return request;
}

Result<int> run_request(const TestRequest& request, ColorChoice color, std::ostream& out, std::ostream& err) {
  TestRun test(request);
  Result<RunReport> report = test.run();
  for (const std::string& note : test.notes()) fmt::print(err, "porttape test: {}\n", printable_line(note));
  if (!report) return report.error();
  report->outcome = outcome_text(*report, test.end());
  report->command_end = command_end_text(*report, test.end());
  out << to_text(*report, wants_color(out, color)) << std::flush;
  report->process_exit = output_status(out, exit_status_of(*report, test.end()));
  if (!request.replay().report_file.empty()) {
    if (Result<void> written =
            write_report(request.replay().report_file, to_json(*report, test.runs().json()));
        !written)
      return written.error();
  }
  return *report->process_exit;
}

}  // namespace

int run_test(Arguments args, std::ostream& out, std::ostream& err) {
  const CommandVerb verb{.name = "test",
                         .usage = "--tape NAME [options] -- COMMAND…",
                         .about = kAbout,
                         .options = test_options(),
                         .example = "--tape laser -- ./laser_driver --device {port}"};
  return run_command_verb(verb, args, out, err, [&](CommandVerbLine line) -> Result<int> {
    const Result<ColorChoice> color = take_color(line);
    if (!color) return color.error();
    const Result<TestRequest> request = read_request(std::move(line), verb.options);
    if (!request) return request.error();
    return run_request(*request, *color, out, err);
  });
}

}  // namespace porttape
