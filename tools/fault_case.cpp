#include "tools/fault_case.hpp"

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <initializer_list>
#include <iterator>
#include <thread>
#include <utility>

#include "libport/base/printable.hpp"
#include "libport/catalog/channel.hpp"
#include "libport/faults/types.hpp"
#include "tools/command_end.hpp"
#include "tools/option_description.hpp"
#include "tools/test_request.hpp"

namespace porttape {
namespace {

using Kind = OptionSpec::Kind;

constexpr std::size_t kLinesShown = 8;

// What a run of these verbs has where nothing else is said: no waiting, and answers to whoever asks again.
constexpr std::array<std::pair<std::string_view, std::string_view>, 3> kDefaults = {
    {{"timing", "none"}, {"match", "lookup"}, {"on-mismatch", "warn"}}};

const OptionSpec kFailsBy{
    "fails-by",
    Kind::choice,
    "status",
    "what is a failure: a command that is ended by a signal or hangs (signal), also one that "
    "ends with another status than 0 (status), also a verdict other than pass",
    0,
    0,
    {"signal", "status", "verdict"}};
const OptionSpec kJobs{.name = "jobs",
                       .kind = Kind::integer,
                       .help = "so many runs at a time; default: one for each processor",
                       .min = 1,
                       .max = 1000};

const OptionSpec kFormat{"format", Kind::choice,    "text", "how the result comes on stdout", 0,
                         0,        {"text", "json"}};

bool is_one_of(std::string_view name, std::initializer_list<std::string_view> names) {
  return std::ranges::find(names, name) != names.end();
}

// Takes an option away from the line, checked.
Result<std::optional<std::string>> take(CommandVerbLine& line, const OptionSpec& option) {
  const auto given = line.values.extract(std::string(option.name));
  if (!given) return std::optional<std::string>();
  Result<std::string> checked = check_value(option, given.mapped());
  if (!checked) return checked.error();
  return std::optional(std::move(*checked));
}

Result<void> take_faults(CommandVerbLine& line, FaultCase& the_case) {
  const auto faults = line.values.extract("faults");
  const auto seed = line.values.extract("seed");
  if (!faults && !seed) return {};
  // As `test` reads them, with its messages.
  OptionValues both;
  if (faults) both["faults"] = faults.mapped();
  if (seed) both["seed"] = seed.mapped();
  both["tape"] = the_case.tape.name();
  both["driver"] = "pty:port";
  const ReadChannel channel = read_channel({ChannelMode::replay, both});
  if (!channel.problems.empty()) return channel.problems.front().error;
  const PortOptions& written = channel.device->written();
  the_case.faults = written.text("faults");
  the_case.seed = static_cast<std::uint64_t>(written.number("seed"));
  return {};
}

std::vector<std::string> option_words(const FaultCase& the_case, bool of_test) {
  std::vector<std::string> words;
  const std::vector<OptionSpec> specs = test_options();
  for (const auto& [name, value] : the_case.setup.values) {
    if (name == "tape") continue;
    const auto spec = std::ranges::find(specs, name, &OptionSpec::name);
    const bool usual =
        std::ranges::count(kDefaults, std::pair(std::string_view(name), std::string_view(value))) > 0;
    if (usual && !of_test) continue;
    words.push_back("--" + name);
    if (spec == specs.end() || spec->kind != Kind::flag) words.push_back(value);
  }
  return words;
}

std::string line_of(const FaultCase& the_case, std::vector<std::string> words, const std::string& faults,
                    std::uint64_t seed, bool of_test, const std::vector<std::string>& more = {}) {
  std::ranges::move(option_words(the_case, of_test), std::back_inserter(words));
  if (!faults.empty()) words.insert(words.end(), {"--faults", faults, "--seed", std::to_string(seed)});
  words.insert(words.end(), more.begin(), more.end());
  words.emplace_back("--");
  words.insert(words.end(), the_case.setup.command.begin(), the_case.setup.command.end());
  return shell_line(words);
}

}  // namespace

std::vector<OptionSpec> fault_case_options() {
  std::vector<OptionSpec> specs = test_options();
  std::erase_if(specs, [](const OptionSpec& spec) {
    return is_one_of(spec.name, {"driver", "report", "junit", "connections"});
  });
  for (OptionSpec& spec : specs) {
    for (const auto& [name, value] : kDefaults) {
      if (spec.name == name) spec.default_value = value;
    }
  }
  specs.push_back(kFailsBy);
  specs.push_back(kJobs);
  specs.push_back(kFormat);
  return specs;
}

Result<FaultCase> read_fault_case(CommandVerbLine& line) {
  FaultCase the_case;
  line.values.erase("driver");  // each run has its own
  const auto by = take(line, kFailsBy);
  if (!by) return by.error();
  if (*by && **by != "status")
    the_case.fails_by = **by == "signal" ? FaultCase::FailsBy::signal : FaultCase::FailsBy::verdict;
  const auto jobs = take(line, kJobs);
  if (!jobs) return jobs.error();
  the_case.jobs = *jobs ? std::stoul(**jobs) : std::max(1U, std::thread::hardware_concurrency());
  const auto format = take(line, kFormat);
  if (!format) return format.error();
  the_case.as_json = *format == "json";
  const auto tape = line.values.find("tape");
  if (tape == line.values.end()) return make_error(Errc::usage, "option 'tape' is missing: NAME, the tape");
  const Result<TapePaths> found = find_tape(tape->second);
  if (!found) return found.error();
  the_case.tape = *found;
  if (Result<void> taken = take_faults(line, the_case); !taken) return taken.error();
  const std::vector<OptionSpec> known = test_options();
  for (const auto& [name, value] : kDefaults) {
    if (std::ranges::find(known, name, &OptionSpec::name) != known.end())
      line.values.try_emplace(std::string(name), value);
  }
  line.values.erase("tape");
  the_case.setup = {std::move(line.values), std::move(line.command)};
  // All that can be wrong with the rest is told before anything runs.
  auto values = the_case.setup.values;
  values["tape"] = the_case.tape.name();
  values["driver"] = "pty:port";
  const Result<TestRequest> request = read_test(std::move(values), the_case.setup.command);
  if (!request) return request.error();
  return the_case;
}

std::optional<FaultFailure> failure_of(const FaultRunEnd& end, FaultCase::FailsBy by) {
  const CommandEnd command{end.status, end.signal};
  if (!end.ended_because.empty()) return FaultFailure{"the command " + end.ended_because, "hung"};
  if (end.signal != 0)
    return FaultFailure{"the command " + command.text(), fmt::format("signal {}", end.signal)};
  if (by == FaultCase::FailsBy::signal) return std::nullopt;
  if (end.status != 0)
    return FaultFailure{"the command " + command.text(), fmt::format("status {}", end.status)};
  if (by == FaultCase::FailsBy::status || end.passed) return std::nullopt;
  return FaultFailure{"the verdict is " + end.verdict, "verdict " + end.verdict};
}

std::string test_line(const FaultCase& the_case, const std::string& tape, const std::string& faults,
                      std::uint64_t seed) {
  return line_of(the_case, {"porttape", "test", "--tape", tape}, faults, seed, true);
}

std::string shrink_line(const FaultCase& the_case, const std::string& faults, std::uint64_t seed) {
  std::string name = the_case.tape.name();
  if (name.ends_with(".log")) name.resize(name.size() - 4);
  std::vector<std::string> more = {"-o", name + ".small"};
  if (the_case.fails_by != FaultCase::FailsBy::status)
    more.insert(more.end(),
                {"--fails-by", the_case.fails_by == FaultCase::FailsBy::signal ? "signal" : "verdict"});
  return line_of(the_case, {"porttape", "shrink", "--tape", the_case.tape.name()}, faults, seed, false, more);
}

std::string last_lines(const std::string& output) {
  std::vector<std::string> lines;
  for (std::size_t at = 0; at < output.size();) {
    const std::size_t end = std::min(output.find('\n', at), output.size());
    if (end > at) lines.push_back(output.substr(at, end - at));
    at = end + 1;
  }
  std::string text;
  for (std::size_t n = lines.size() - std::min(lines.size(), kLinesShown); n < lines.size(); ++n)
    text += "    " + printable_line(lines[n]) + '\n';
  return text;
}

}  // namespace porttape
