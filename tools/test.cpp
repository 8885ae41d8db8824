#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <optional>
#include <ostream>
#include <signal.h>
#include <span>
#include <stdlib.h>
#include <string>
#include <unistd.h>
#include <utility>
#include <vector>

#include <boost/program_options/errors.hpp>

#include "libport/base/printable.hpp"
#include "libport/catalog/channel.hpp"
#include "libport/taped/report_file.hpp"
#include "libport/taped/types.hpp"
#include "tools/option_description.hpp"
#include "tools/output.hpp"
#include "tools/test_run.hpp"
#include "tools/verbs.hpp"

namespace porttape {
namespace {

namespace po = boost::program_options;

constexpr std::string_view kHelp =
    "Usage: porttape test --tape NAME [options] -- COMMAND…\n\n"
    "Runs COMMAND against a tape in the device's place and prints the verdict. {port} in COMMAND is the path "
    "to open.\n\n"
    "Example: porttape test --tape laser -- ./laser_driver --device {port}\n";

// A folder of our own for the driver's port.
class PrivateFolder {
 public:
  Result<std::string> make() {
    std::string path = (std::filesystem::temp_directory_path() / "porttape-XXXXXX").string();
    if (::mkdtemp(path.data()) == nullptr)
      return make_error(Errc::io, fmt::format("folder '{}': {}", path, errno_text(errno)));
    path_ = path;
    return path;
  }
  PrivateFolder() = default;
  PrivateFolder(const PrivateFolder&) = delete;
  PrivateFolder& operator=(const PrivateFolder&) = delete;
  ~PrivateFolder() {
    if (!path_.empty()) (void)::rmdir(path_.c_str());
  }

 private:
  std::string path_;
};

std::vector<OptionSpec> test_options() {
  std::vector<OptionSpec> specs = channel_options(ChannelMode::replay);
  std::erase_if(specs, [](const OptionSpec& spec) { return spec.name == "once"; });
  for (OptionSpec& spec : specs) {
    spec.default_value = replay_default(ReplayUse::test, spec.name, spec.default_value);
    if (spec.name == "driver") spec.help = "PORT for the command instead of a pty in a private folder";
  }
  specs.push_back({"timeout", OptionSpec::Kind::number, "",
                   "seconds after which the command is ended; 0: never, not even one that sleeps for ever", 0,
                   1e9});
  specs.push_back({"color",
                   OptionSpec::Kind::choice,
                   "auto",
                   "of the verdict; auto: on a terminal, unless NO_COLOR is set",
                   0,
                   0,
                   {"auto", "always", "never"}});
  specs.push_back({"help", OptionSpec::Kind::flag, "", "this text"});
  return specs;
}

Result<TestRequest> read_request(const po::variables_map& values, const std::vector<OptionSpec>& specs,
                                 PrivateFolder& folder, std::vector<std::string> command) {
  ChannelSpec channel{ChannelMode::replay, given_values(values, specs)};
  channel.values.erase("color");
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
  if (!channel.values.contains("driver")) {
    const Result<std::string> path = folder.make();
    if (!path) return path.error();
    channel.values["driver"] = "pty:" + *path + "/port";
  }
  Result<ChannelPorts> ports = channel_ports(channel);
  if (!ports) return ports.error();
  TestRequest request{std::move(*ports), limit, never_ends, std::move(command)};
  if (const std::string& file = request.replay().report_file; !file.empty()) {
    if (Result<void> place = check_report_place(file); !place) return place.error();
  }
  if (request.command.empty())
    return make_error(Errc::usage, "the command is missing: porttape test --tape NAME -- COMMAND…");
  return request;
}

int fail(const Error& error, std::ostream& err) {
  fmt::print(err, "porttape test: {}\n", printable_line(error.message));
  return exit_status_of(error.code);
}

int run_request(const TestRequest& request, ColorChoice color, std::ostream& out, std::ostream& err) {
  ::signal(SIGPIPE, SIG_IGN);
  TestRun test(request);
  Result<RunReport> report = test.run();
  for (const std::string& note : test.notes()) fmt::print(err, "porttape test: {}\n", printable_line(note));
  if (!report) return fail(report.error(), err);
  RunReport shown = *report;
  shown.tape = printable_line(shown.tape);
  out << to_text(shown, wants_color(out, color)) << std::flush;
  if (report->command_exit.value_or(0) != 0)
    fmt::print(err, "porttape test: the command ended with status {}\n", *report->command_exit);
  report->process_exit = output_status(out, test.exit_status(*report));
  if (!request.replay().report_file.empty()) {
    if (Result<void> written = write_report(request.replay().report_file, to_json(*report)); !written)
      return fail(written.error(), err);
  }
  return *report->process_exit;
}

}  // namespace

int run_test(Arguments args, std::ostream& out, std::ostream& err) {
  const auto separator = std::ranges::find(args, "--");
  const Arguments options(args.begin(), separator);
  std::vector<std::string> command;
  if (separator != args.end()) command.assign(separator + 1, args.end());
  const std::vector<OptionSpec> specs = test_options();
  try {
    const po::options_description description = describe(specs, "Options");
    const po::variables_map values = read_options(options, description);
    if (values.contains("help")) {
      out << kHelp << '\n' << as_text(description);
      return exit_status::kPass;
    }
    const std::string when = values.contains("color") ? values["color"].as<std::string>() : "auto";
    const std::optional<ColorChoice> color = parse_color(when);
    if (!color) {
      return fail(make_error(Errc::usage,
                             "option 'color': '" + when + "' is not valid; accepted: auto, always, never"),
                  err);
    }
    PrivateFolder folder;
    const Result<TestRequest> request = read_request(values, specs, folder, std::move(command));
    if (!request) return fail(request.error(), err);
    return run_request(*request, *color, out, err);
  } catch (const po::error& error) {
    return fail(make_error(Errc::usage, fmt::format("{}; see porttape test --help", error.what())), err);
  }
}

}  // namespace porttape
