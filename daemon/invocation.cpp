#include "daemon/invocation.hpp"

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <iterator>
#include <string_view>
#include <utility>

#include <boost/program_options/errors.hpp>
#include <boost/program_options/value_semantic.hpp>

#include "daemon/channel_check.hpp"
#include "daemon/config_file.hpp"
#include "libport/base/printable.hpp"
#include "libport/base/version.hpp"
#include "libport/catalog/port_guess.hpp"
#include "libport/catalog/port_types.hpp"
#include "tools/option_description.hpp"
#include "tools/verb_advice.hpp"

namespace porttape {
namespace {

namespace po = boost::program_options;

constexpr std::string_view kUsage =
    "Usage: porttaped record --device PORT --driver PORT --tape NAME [options]\n"
    "       porttaped replay --tape NAME --driver PORT [options]\n"
    "       porttaped bridge --device PORT --driver PORT [options]\n"
    "       porttaped run CONFIG [options]\n"
    "       porttaped VERB --help | --help | --help-ports | --version\n\n"
    "Sits between a driver and a device, records both directions, and plays a\n"
    "recording back in the device's place.\n\n"
    "Example: porttaped record --device /dev/ttyUSB0,baud=115200 \\\n"
    "           --driver pty:/tmp/laser --tape laser\n";

constexpr std::string_view kRunHelp =
    "Usage: porttaped run CONFIG [options]\n\n"
    "Runs every channel of a configuration file.\n\n"
    "CONFIG is an INI file with a section a channel; its keys are the options of the\n"
    "verbs. A section with device and tape records, with tape alone it replays, with\n"
    "device alone it bridges:\n\n"
    "    # comment\n"
    "    [channel laser]\n"
    "    device = serial:/dev/ttyUSB0,baud=115200\n"
    "    driver = pty:/run/porttape/robot/laser,mode=0660,group=dialout\n"
    "    tape = laser\n\n"
    "As /etc/porttape/robot.conf this is run by the unit porttaped@robot: its links\n"
    "go to /run/porttape/robot, its tapes to /var/log/porttape/robot, and a driver's\n"
    "user is in the group dialout.\n\n"
    "What is wrong in the file is told with its lines, and nothing starts. A channel\n"
    "in trouble (its device is missing, say) is tried again after 1 s, 2 s, … 30 s;\n"
    "the others go on. A tape whose name is taken gets the next free one (on-existing\n"
    "= next). Signals: SIGTERM and SIGINT end (a second one at once), SIGUSR1 starts\n"
    "the next tapes, SIGHUP opens the log file again. Exit status: 2 for a wrong\n"
    "configuration, else the worst of the channels that ended: 0, the verdicts of\n"
    "replays (3, 4, 5), 1 for a tape that is incomplete.\n\n"
    "Example: porttaped run robot.conf --check-config\n\n";

struct ModeVerb {
  std::string_view name;
  ChannelMode mode;
  std::string_view help;
  std::string_view example;
};

constexpr ModeVerb kModeVerbs[] = {
    {"record", ChannelMode::record, "Passes bytes between a driver and a device and keeps a tape of them.",
     "porttaped record --device /dev/ttyUSB0,baud=115200 \\\n"
     "           --driver pty:/tmp/laser --tape laser"},
    {"replay", ChannelMode::replay, "Is the device: plays a tape back and checks what the driver writes.",
     "porttaped replay --tape laser --driver pty:/tmp/laser \\\n"
     "           --report report.json"},
    {"bridge", ChannelMode::bridge, "Passes bytes between a driver and a device.",
     "porttaped bridge --device /dev/ttyUSB0,baud=115200 \\\n"
     "           --driver pty:/tmp/laser"},
};
constexpr std::string_view kRun = "run";
static_assert(std::size(kModeVerbs) + 1 == kDaemonVerbs.size());

using Kind = OptionSpec::Kind;

const OptionSpec kLogLevel{"log-level",
                           Kind::choice,
                           "info",
                           "how much is logged; trace shows the bytes: -> the driver writes, <- it is sent",
                           0,
                           0,
                           {"trace", "debug", "info", "warn", "error", "off"}};

std::vector<OptionSpec> common_options() {
  return {
      {"help", Kind::flag, "", "this text"},
      {"help-ports", Kind::flag, "", "what a PORT is: all types and their options"},
      kLogLevel,
      {.name = "log-file",
       .help = "writes the log there, not to stderr (through no link of another user); with -b and without "
               "it: to the journal or syslog, else to $XDG_STATE_HOME/porttape/PID.log",
       .value_name = "FILE"},
      {"background", Kind::flag, "", "returns once the link is there and goes on in the background"},
      {.name = "pidfile",
       .help =
           "writes the process's number there; another user's file is refused, and one that others may write",
       .value_name = "FILE"},
  };
}

Result<void> take_common(const po::variables_map& values, Invocation& line) {
  if (values.contains("log-level")) {
    const Result<std::string> level = check_value(kLogLevel, values["log-level"].as<std::string>());
    if (!level) return level.error();
    line.log_level = spdlog::level::from_str(*level);
  }
  if (values.contains("log-file")) line.log_file = values["log-file"].as<std::string>();
  if (values.contains("pidfile")) line.pid_file = values["pidfile"].as<std::string>();
  line.background = values.contains("background");
  return {};
}

Result<Invocation> help_ports() {
  Invocation line;
  line.print = port_help(port_types());
  return line;
}

// The line with the option that a bare word is the value of, and with what is missing besides.
std::string with_option(const ModeVerb& verb, std::span<const std::string> arguments,
                        const StrayWord& stray) {
  std::vector<std::string> line(arguments.begin(), arguments.end());
  const auto is_given = [&](const std::string& option) {
    return std::ranges::any_of(line, [&](const std::string& word) {
      return word == "--" + option || word.starts_with("--" + option + "=");
    });
  };
  std::vector<std::pair<std::string, std::string>> wanted = {
      {"device", "/dev/ttyUSB0"}, {"driver", "pty:/tmp/port"}, {"tape", "NAME"}};
  if (!looks_like_port(stray.word())) std::rotate(wanted.begin(), wanted.end() - 1, wanted.end());
  const std::vector<OptionSpec> known = channel_options(verb.mode);
  std::erase_if(wanted, [&](const auto& option) {
    return is_given(option.first) || std::ranges::find(known, option.first, &OptionSpec::name) == known.end();
  });
  if (wanted.empty()) return {};
  const auto word = line.begin() + static_cast<std::ptrdiff_t>(stray.index());
  if (wanted.front().first == "device") *word = device_for(*word);
  line.insert(word, "--" + wanted.front().first);
  for (const auto& [option, example] : std::span(wanted).subspan(1))
    line.insert(line.end(), {"--" + option, example});
  line.insert(line.begin(), {"porttaped", std::string(verb.name)});
  return shell_line(line);
}

// Reads the options of a verb, and gives what is wrong with them.
Result<po::variables_map> read_verb(const ModeVerb& verb, std::span<const std::string> arguments,
                                    const po::options_description& options) {
  const std::string command = fmt::format("porttaped {}", verb.name);
  try {
    return read_options(arguments, options);
  } catch (const UnknownOption& unknown) {
    const auto owner = owner_of_option(unknown.option(), verb.mode);
    return usage_error(owner ? *owner : with_help(unknown.what(), command));
  } catch (const StrayWord& stray) {
    const std::string line = with_option(verb, arguments, stray);
    if (line.empty()) return usage_error(with_help(stray.what(), command));
    return usage_error(
        fmt::format("{} stands alone; did you mean {}?", in_quotes(stray.word()), in_quotes(line)));
  }
}

Result<Invocation> parse_verb(const ModeVerb& verb, std::span<const std::string> arguments) {
  const std::vector<OptionSpec> specs = channel_options(verb.mode);
  const po::options_description own = describe(specs, fmt::format("Options of {}", verb.name));
  const po::options_description common = describe(common_options(), "Common options");
  po::options_description options;
  options.add(own).add(common);
  const Result<po::variables_map> values = read_verb(verb, arguments, options);
  if (!values) return values.error();
  Invocation line;
  if (values->contains("help-ports")) return help_ports();
  if (values->contains("help")) {
    line.print = fmt::format(
        "Usage: porttaped {} [options]\n\n{}\n\nExample: {}\n\n{}\n{}\n"
        "`porttaped --help-ports` tells what a PORT is.\n",
        verb.name, verb.help, verb.example, as_text(own), as_text(common));
    return line;
  }
  if (Result<void> taken = take_common(*values, line); !taken) return taken.error();
  line.verb = verb.name;
  line.channels.emplace(verb.name, ChannelSpec{verb.mode, given_values(*values, specs)});
  const std::vector<ChannelProblem> problems = check_channels(line.channels);
  if (!problems.empty()) return problems.front().problem.error;
  return line;
}

Result<Invocation> run_channels(Invocation line, const std::string& file, bool check_only) {
  Result<std::map<std::string, ChannelSpec>> channels = read_config_file(file);
  if (!channels) return channels.error();
  if (check_only) {
    line.print = fmt::format("{}: {} channel{}, good\n", printable_line(file), channels->size(),
                             channels->size() == 1 ? "" : "s");
    return line;
  }
  line.channels = std::move(*channels);
  line.verb = "run";
  line.keeps_channels = true;
  return line;
}

Result<Invocation> parse_run(std::span<const std::string> arguments) {
  std::vector<OptionSpec> specs = common_options();
  specs.insert(specs.begin(),
               {"check-config", Kind::flag, "", "says what is wrong in CONFIG, and starts nothing"});
  const po::options_description options = describe(specs, "Options");
  po::options_description all;
  all.add(options).add_options()("config", po::value<std::string>()->value_name("CONFIG"));
  po::positional_options_description positions;
  positions.add("config", 1);
  const po::variables_map values = read_options(arguments, all, positions);
  Invocation line;
  if (values.contains("help-ports")) return help_ports();
  if (values.contains("help")) {
    line.print = std::string(kRunHelp) + as_text(options);
    return line;
  }
  if (Result<void> taken = take_common(values, line); !taken) return taken.error();
  if (!values.contains("config"))
    return usage_error("the configuration file is missing; type porttaped run CONFIG");
  return run_channels(std::move(line), values["config"].as<std::string>(), values.contains("check-config"));
}

Result<Invocation> parse(std::span<const std::string> arguments) {
  if (arguments.empty()) return usage_error(no_verb("porttaped", arguments));
  if (arguments.front() == "help" && arguments.size() > 1)
    return parse_invocation(std::array<std::string, 2>{arguments[1], "--help"});
  const std::string& verb = arguments.front();
  Invocation line;
  if (verb == "--help" || verb == "-h" || verb == "help") {
    line.print = kUsage;
    return line;
  }
  if (verb == "--help-ports") return help_ports();
  if (verb == "--version") {
    line.print = fmt::format("porttaped {}\n", version());
    return line;
  }
  if (verb == kRun) return parse_run(arguments.subspan(1));
  for (const ModeVerb& known : kModeVerbs) {
    if (known.name == verb) return parse_verb(known, arguments.subspan(1));
  }
  return usage_error(no_verb("porttaped", arguments));
}

}  // namespace

Result<Invocation> parse_invocation(std::span<const std::string> arguments) {
  try {
    return parse(arguments);
  } catch (const StrayWord& stray) {
    return usage_error(fmt::format("run takes one CONFIG; {} is one too many", in_quotes(stray.word())));
  } catch (const po::error& error) {
    return usage_error(with_help(error.what(), "porttaped " + arguments.front()));
  }
}

}  // namespace porttape
