#include "daemon/invocation.hpp"

#include <fmt/format.h>
#include <string_view>
#include <utility>

#include <boost/program_options/errors.hpp>
#include <boost/program_options/value_semantic.hpp>

#include "daemon/config_file.hpp"
#include "libport/base/version.hpp"
#include "libport/catalog/port_types.hpp"
#include "tools/option_description.hpp"

namespace porttape {
namespace {

namespace po = boost::program_options;

constexpr std::string_view kUsage =
    "Usage: porttaped record --device PORT --driver PORT --tape NAME [--on-existing refuse|next|overwrite]\n"
    "       porttaped replay --tape NAME --driver PORT [replay options]\n"
    "       porttaped bridge --device PORT --driver PORT\n"
    "       porttaped run CONFIG\n"
    "       porttaped VERB --help, --help-ports, --version\n\n"
    "Sits between a driver and a device, records both directions, and plays a recording back in the device's "
    "place.\n";

constexpr std::string_view kRunHelp =
    "CONFIG is an INI file with a section a channel; its keys are the options of the verbs. A section with "
    "device and tape\n"
    "records, with tape alone it replays, with device alone it bridges:\n\n"
    "    [channel laser]\n"
    "    device = serial:/dev/ttyUSB0,baud=115200\n"
    "    driver = pty:/run/porttape/robot/laser,mode=0660,group=dialout\n"
    "    tape = laser\n\n"
    "As /etc/porttape/robot.conf this is run by the unit porttaped@robot: its links go to "
    "/run/porttape/robot, "
    "its tapes\n"
    "to /var/log/porttape/robot, and a driver's user is in the group dialout.\n\n"
    "A channel in trouble (its device is missing, say) is tried again after 1 s, 2 s, … 30 s; the others go "
    "on. A tape\n"
    "whose name is taken gets the next free one (on-existing = next). Signals: SIGTERM and SIGINT end (a "
    "second one at\n"
    "once), SIGUSR1 starts the next tapes, SIGHUP opens the log file again. Exit status: 2 for a wrong "
    "configuration,\n"
    "else the worst of the channels that ended: 0, the verdicts of replays (3, 4, 5), 1 for a tape that is "
    "incomplete.\n";

struct Verb {
  std::string_view name;
  ChannelMode mode;
  std::string_view help;
  std::string_view example;
};

constexpr Verb kVerbs[] = {
    {"record", ChannelMode::record, "Passes bytes between a driver and a device and keeps a tape of them.",
     "porttaped record --device /dev/ttyUSB0,baud=115200 --driver pty:/tmp/laser --tape laser"},
    {"replay", ChannelMode::replay, "Is the device: plays a tape back and checks what the driver writes.",
     "porttaped replay --tape laser --driver pty:/tmp/laser --report report.json"},
    {"bridge", ChannelMode::bridge, "Passes bytes between a driver and a device.",
     "porttaped bridge --device /dev/ttyUSB0,baud=115200 --driver pty:/tmp/laser"},
};

Error usage(std::string message) { return make_error(Errc::usage, std::move(message)); }

po::options_description common_options() {
  po::options_description options("Common options");
  options.add_options()      //
      ("help", "this text")  //
      ("log-level", po::value<std::string>()->default_value("info"),
       "trace, debug, info, warn, error, off; trace shows the bytes: -> the driver writes, <- it is sent")  //
      ("log-file", po::value<std::string>(),
       "writes the log there, not to stderr; with -b and without it: to the journal or syslog, else to "
       "$XDG_STATE_HOME/porttape/PID.log")                                              //
      ("background,b", "returns once the link is there and goes on in the background")  //
      ("pidfile", po::value<std::string>(), "writes the process's number there");
  return options;
}

Result<void> take_common(const po::variables_map& values, Invocation& line) {
  const std::string level = values["log-level"].as<std::string>();
  line.log_level = spdlog::level::from_str(level);
  if (line.log_level == spdlog::level::off && level != "off") {
    return usage(fmt::format(
        "option 'log-level': '{}' is not valid; accepted: trace, debug, info, warn, error, off", level));
  }
  if (values.contains("log-file")) line.log_file = values["log-file"].as<std::string>();
  if (values.contains("pidfile")) line.pid_file = values["pidfile"].as<std::string>();
  line.background = values.contains("background");
  return {};
}

Result<Invocation> parse_verb(const Verb& verb, std::span<const std::string> arguments) {
  const std::vector<OptionSpec> specs = channel_options(verb.mode);
  po::options_description options = describe(specs, fmt::format("Options of {}", verb.name));
  options.add(common_options());
  const po::variables_map values = read_options(arguments, options);
  Invocation line;
  if (values.contains("help")) {
    line.print = fmt::format(
        "Usage: porttaped {} [options]\n\n{}\n\nExample: {}\n\n{}\n`porttaped --help-ports` tells what a "
        "PORT is.\n",
        verb.name, verb.help, verb.example, as_text(options));
    return line;
  }
  if (Result<void> taken = take_common(values, line); !taken) return taken.error();
  line.verb = verb.name;
  line.channels.emplace(verb.name, ChannelSpec{verb.mode, given_values(values, specs)});
  return line;
}

Result<Invocation> parse_run(std::span<const std::string> arguments) {
  po::options_description hidden;
  hidden.add_options()("config", po::value<std::string>());
  po::options_description options = common_options();
  po::options_description all;
  all.add(options).add(hidden);
  po::positional_options_description positions;
  positions.add("config", 1);
  const po::variables_map values = read_options(arguments, all, positions);
  Invocation line;
  if (values.contains("help")) {
    line.print = fmt::format(
        "Usage: porttaped run CONFIG [options]\n\nRuns every channel of a configuration file.\n\n{}\n{}",
        kRunHelp, as_text(options));
    return line;
  }
  if (Result<void> taken = take_common(values, line); !taken) return taken.error();
  if (!values.contains("config"))
    return usage("run: the configuration file is missing; see porttaped run --help");
  Result<std::map<std::string, ChannelSpec>> channels = read_config_file(values["config"].as<std::string>());
  if (!channels) return channels.error();
  line.channels = std::move(*channels);
  line.verb = "run";
  line.keeps_channels = true;
  return line;
}

Result<Invocation> parse(std::span<const std::string> arguments) {
  if (arguments.empty())
    return usage("a verb is missing: record, replay, bridge or run; see porttaped --help");
  const std::string& verb = arguments.front();
  Invocation line;
  if (verb == "--help" || verb == "-h" || verb == "help") {
    line.print = kUsage;
    return line;
  }
  if (verb == "--help-ports") {
    line.print = port_help(port_types());
    return line;
  }
  if (verb == "--version") {
    line.print = fmt::format("porttaped {}\n", version());
    return line;
  }
  if (verb == "run") return parse_run(arguments.subspan(1));
  for (const Verb& known : kVerbs) {
    if (known.name == verb) return parse_verb(known, arguments.subspan(1));
  }
  return usage(
      fmt::format("unknown verb '{}'; accepted: record, replay, bridge, run; see porttaped --help", verb));
}

}  // namespace

Result<Invocation> parse_invocation(std::span<const std::string> arguments) {
  try {
    return parse(arguments);
  } catch (const po::error& error) {
    const bool of_verb = !arguments.empty() && !arguments.front().starts_with('-');
    return usage(
        fmt::format("{}; see porttaped {}--help", error.what(), of_verb ? arguments.front() + " " : ""));
  }
}

}  // namespace porttape
