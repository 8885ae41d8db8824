#include "tools/command_verb.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <fmt/ostream.h>
#include <signal.h>
#include <utility>

#include <boost/program_options/errors.hpp>

#include "libport/base/printable.hpp"
#include "libport/catalog/port_guess.hpp"
#include "tools/option_description.hpp"
#include "tools/private_folder.hpp"
#include "tools/verb_advice.hpp"

namespace porttape {
namespace {

namespace po = boost::program_options;

constexpr std::string_view kPlaceHelp =
    "{port} in COMMAND is what it is to open: the path of a tty, or HOST:PORT of a\n"
    "socket ({host} and {tcp_port} are its parts). The environment has the same:\n"
    "PORTTAPE_PORT, and for a socket PORTTAPE_HOST and PORTTAPE_TCP_PORT.\n";

std::vector<OptionSpec> options_of(const CommandVerb& verb) {
  std::vector<OptionSpec> specs = verb.options;
  for (OptionSpec& spec : specs) {
    if (spec.name == "driver") spec.help = "what the command opens instead of a pty in a private folder";
  }
  specs.push_back({"help", OptionSpec::Kind::flag, "", "this text"});
  return specs;
}

void print_help(const CommandVerb& verb, const po::options_description& options, std::ostream& out) {
  fmt::print(out, "Usage: porttape {0} {1}\n\n{2}{3}\nExample:\n  porttape {0} {4}\n\n{5}", verb.name,
             verb.usage, verb.about, verb.has_port ? kPlaceHelp : "", verb.example, as_text(options));
}

Result<int> do_work(const CommandVerb& verb, CommandVerbLine line,
                    const std::function<Result<int>(CommandVerbLine)>& work) {
  const bool alone = line.values.contains(std::string(verb.alone));
  if (line.command.empty() && !alone)
    return make_error(Errc::usage,
                      fmt::format("the command is missing; type porttape {} {}", verb.name, verb.usage));
  // A reader that goes away, and a limit on the size of files, are errors of a write.
  ::signal(SIGPIPE, SIG_IGN);
  ::signal(SIGXFSZ, SIG_IGN);
  PrivateFolder folder;
  if (verb.has_port && !alone && !line.values.contains("driver")) {
    const Result<std::string> path = folder.make();
    if (!path) return path.error();
    line.values["driver"] = "pty:" + *path + "/port";
    line.own_driver = true;
  }
  return work(std::move(line));
}

// A command without `--` in front, a device or a tape without its option, or a word too many.
Error stray_word(const CommandVerb& verb, Arguments args, const StrayWord& stray) {
  const auto separator = std::ranges::find(args, "--");
  const auto is_given = [&](const std::string& option) {
    return std::any_of(args.begin(), separator, [&](const std::string& word) {
      return word == "--" + option || word.starts_with("--" + option + "=");
    });
  };
  const bool has_tape = is_given("tape");
  if (separator != args.end() && has_tape)
    return make_error(Errc::usage, with_help(stray.what(), fmt::format("porttape {}", verb.name)));
  std::vector<std::string> line{"porttape", std::string(verb.name)};
  line.insert(line.end(), args.begin(), args.end());
  const bool takes_device =
      std::ranges::find(verb.options, "device", &OptionSpec::name) != verb.options.end();
  if (takes_device && !is_given("device") && looks_like_port(stray.word())) {
    return make_error(Errc::usage,
                      fmt::format("--device is missing before {}; type porttape {} --device {} --tape NAME "
                                  "-- COMMAND…",
                                  in_quotes(stray.word()), verb.name, device_for(stray.word())));
  }
  const bool is_tape = separator != args.end();
  line.insert(line.begin() + 2 + static_cast<std::ptrdiff_t>(stray.index()), is_tape ? "--tape" : "--");
  return make_error(Errc::usage,
                    fmt::format("{} is missing before {}; type {}", is_tape ? "--tape" : "--",
                                is_tape ? in_quotes(stray.word()) : "the command", shell_line(line)));
}

}  // namespace

std::vector<OptionSpec> options_of_one_run(ChannelMode mode) {
  std::vector<OptionSpec> specs = channel_options(mode);
  std::erase_if(specs,
                [](const OptionSpec& spec) { return spec.name == "once" || spec.name == "start-paused"; });
  return specs;
}

int run_command_verb(const CommandVerb& verb, Arguments args, std::ostream& out, std::ostream& err,
                     const std::function<Result<int>(CommandVerbLine)>& work) {
  const auto separator = std::ranges::find(args, "--");
  CommandVerbLine line;
  if (separator != args.end()) line.command.assign(separator + 1, args.end());
  const std::vector<OptionSpec> specs = options_of(verb);
  Result<int> status = exit_status::kPass;
  try {
    const po::options_description description = describe(specs, "Options");
    const po::variables_map values = read_options(Arguments(args.begin(), separator), description);
    if (values.contains("help")) {
      print_help(verb, description, out);
      return exit_status::kPass;
    }
    line.values = given_values(values, specs);
    status = do_work(verb, std::move(line), work);
  } catch (const StrayWord& stray) {
    status = stray_word(verb, args, stray);
  } catch (const po::error& error) {
    status = make_error(Errc::usage, with_help(error.what(), fmt::format("porttape {}", verb.name)));
  }
  if (status) return *status;
  fmt::print(err, "porttape {}: {}\n", verb.name, printable_lines(status.error().message));
  return exit_status_of(status.error().code);
}

}  // namespace porttape
