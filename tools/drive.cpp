#include <algorithm>
#include <chrono>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <optional>
#include <ostream>
#include <signal.h>
#include <string>
#include <utility>
#include <vector>

#include <boost/program_options/errors.hpp>

#include "libport/base/printable.hpp"
#include "libport/catalog/channel.hpp"
#include "libport/catalog/port_guess.hpp"
#include "libport/port/help_table.hpp"
#include "libport/taped/report_file.hpp"
#include "tools/command_verb.hpp"
#include "tools/drive_run.hpp"
#include "tools/option_description.hpp"
#include "tools/output.hpp"
#include "tools/verb_advice.hpp"
#include "tools/verbs.hpp"
#include "tools/verdict_view.hpp"

namespace porttape {
namespace {

namespace po = boost::program_options;

constexpr std::string_view kUsage = "TAPE --device PORT [options]";
constexpr std::string_view kDriveAbout =
    "Plays the driver of a tape to a device, its firmware or a simulator: opens the device as the recorded "
    "driver did, sends what that wrote, and checks what is answered against the tape. A device that speaks "
    "unasked is compared as one stream with its answers; what it sends beyond the tape's last byte is extra, "
    "unless it was streaming where the tape ends.\n\n"
    "Exit status: 0 pass, 1 failure at run time, 2 wrong use, 3 other data, 4 other timing, 5 incomplete, "
    "6 the device is missing or was lost; 130 and 143 when interrupted.\n";
constexpr std::string_view kExample = "porttape drive laser --device /dev/ttyUSB0";

const OptionSpec kDeviceTimeout{.name = "timeout",
                                .kind = OptionSpec::Kind::number,
                                .default_value = "10",
                                .help =
                                    "how long the device may be silent, beyond the time that it took on the "
                                    "tape, before the run ends; 0: for ever",
                                .max = 1e9,
                                .unit = "s"};

std::vector<OptionSpec> drive_specs() {
  std::vector<OptionSpec> specs = options_of_one_run(ChannelMode::drive);
  specs.push_back(kDeviceTimeout);
  for (OptionSpec& view : view_options()) specs.push_back(std::move(view));
  specs.push_back({"help", OptionSpec::Kind::flag, "", "this text"});
  return specs;
}

// A second word: the device, where it is not named yet.
Error stray_word(Arguments args, const StrayWord& stray) {
  const bool has_device = std::ranges::any_of(
      args, [](const std::string& word) { return word == "--device" || word.starts_with("--device="); });
  if (has_device || !looks_like_port(stray.word()))
    return make_error(Errc::usage, with_help(stray.what(), "porttape drive"));
  std::vector<std::string> line{"porttape", "drive"};
  line.insert(line.end(), args.begin(), args.end());
  line.at(2 + stray.index()) = device_for(stray.word());
  line.insert(line.begin() + 2 + static_cast<std::ptrdiff_t>(stray.index()), "--device");
  return make_error(Errc::usage, fmt::format("--device is missing before {}; type {}",
                                             in_quotes(stray.word()), shell_line(line)));
}

Result<DriveRequest> read_request(OptionValues values) {
  const auto written = values.extract("timeout");
  const Result<std::string> timeout =
      check_value(kDeviceTimeout, written ? written.mapped() : std::string(kDeviceTimeout.default_value));
  if (!timeout) return timeout.error();
  std::optional<Nanos> silence;
  if (const std::chrono::duration<double> given(std::stod(*timeout)); given.count() > 0)
    silence = std::chrono::duration_cast<Nanos>(given);
  if (!values.contains("tape"))
    return make_error(Errc::usage, fmt::format("no tape given; type porttape drive {}", kUsage));
  Result<ChannelPorts> ports = channel_ports({ChannelMode::drive, std::move(values)});
  if (!ports) return ports.error();
  DriveRequest request{std::move(*ports), silence};
  for (const std::string& file : {request.replay().report_file, request.replay().junit_file}) {
    if (file.empty()) continue;
    if (Result<void> place = check_report_place(file); !place) return place.error();
  }
  return request;
}

Result<int> drive(const DriveRequest& request, const VerdictView& view, std::ostream& out,
                  std::ostream& err) {
  // A reader that goes away, and a limit on the size of files, are errors of a write.
  ::signal(SIGPIPE, SIG_IGN);
  ::signal(SIGXFSZ, SIG_IGN);
  const ReplayOptions& options = request.replay();
  return end_test(drive_device(request), view,
                  {.verb = "porttape drive", .report = options.report_file, .junit = options.junit_file}, out,
                  err);
}

Result<int> run(Arguments args, std::ostream& out, std::ostream& err) {
  const std::vector<OptionSpec> specs = drive_specs();
  const po::options_description description = describe(specs, "Options");
  po::positional_options_description positions;
  positions.add("tape", 1);
  const po::variables_map values = read_options(args, description, positions);
  if (values.contains("help")) {
    fmt::print(out, "Usage: porttape drive {}\n\n{}\nExample:\n  {}\n\n{}", kUsage, help_text(kDriveAbout),
               kExample, as_text(description));
    return exit_status::kPass;
  }
  OptionValues given = given_values(values, specs);
  given.erase("help");
  const Result<VerdictView> view = take_view(given);
  if (!view) return view.error();
  const Result<DriveRequest> request = read_request(std::move(given));
  if (!request) return request.error();
  return drive(*request, *view, out, err);
}

}  // namespace

int run_drive(Arguments args, std::ostream& out, std::ostream& err) {
  Result<int> status = exit_status::kPass;
  try {
    status = run(args, out, err);
  } catch (const StrayWord& stray) {
    status = stray_word(args, stray);
  } catch (const po::error& error) {
    status = make_error(Errc::usage, with_help(error.what(), "porttape drive"));
  }
  if (status) return *status;
  fmt::print(err, "porttape drive: {}\n", printable_lines(status.error().message));
  return exit_status_of(status.error().code);
}

}  // namespace porttape
